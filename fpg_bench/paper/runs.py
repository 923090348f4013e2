"""The runs of one scenario and budget: a compressed file, a JSON line each, and what their columns say."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded, write_whole
from fpg_bench.common.strict_json import read_object
from fpg_bench.game.metrics import measures, pool, spectrum_overlap
from fpg_bench.game.state import TALLY

WINDOWS = 40
FINAL = WINDOWS  # the row of what was played without noise once training was over
# Planned paths start afresh with each match of ten rounds, so what is compared has to be of whole matches.
# In a fifth of the full budget each game plays 31.2 rounds in the paper's game and 10.4 in the standard one.
FIFTH = WINDOWS // 5
STAGES = {
    "early": range(FIFTH),
    "middle": range((WINDOWS - FIFTH) // 2, (WINDOWS + FIFTH) // 2),
    "late": range(WINDOWS - FIFTH, WINDOWS),
}
_REWARDS = ("ally_reward", "ally_sd", "opponent_reward", "opponent_sd")
MEASURES = (
    "overlap_ratio",
    "jamming_success_rate",
    "spectrum_overlap",
    "hop_rate",
    "spread_ratio",
    "near_ratio",
    "snr_db",
    "share_tone",
    "share_narrowband",
    "share_broadband",
    "share_comb",
)
_HISTOGRAMS = ("ally_points", "jam_points")
_PATHS = ("ally_path", "opponent_path")
LISTS = (*_HISTOGRAMS, *_PATHS)
COLUMNS = ("window", "steps", "rounds", *_REWARDS, *MEASURES, *LISTS)
Row = dict[str, Any]


def window_row(
    window: int, steps: int, rounds: Sequence[tuple[np.void, np.ndarray]], paths: np.ndarray | None = None
) -> Row:
    """One row: the rounds of a window, pooled.

    Args:
        window: its number; :data:`FINAL` for the rounds without noise.
        steps: steps of the run at the window's end.
        rounds: the tally and the histogram ``(2, points)`` of each.
        paths: where both sides flew in a round, ``(2, n, 3)`` in m; None: not to be drawn.

    Returns:
        By the names of :data:`COLUMNS`: rewards per step with their standard deviation over rounds,
        measures of the pooled rounds, in the windows of Fig. 4 the steps per frequency point, and the
        paths in whole metres, x, y and z of one position after the other.
    """
    tallies = np.array([tally for tally, _ in rounds], TALLY)
    histogram = np.sum([each for _, each in rounds], axis=0)
    found = measures(pool(tallies), histogram)
    row: Row = {"window": window, "steps": steps, "rounds": len(rounds)}
    for side in ("ally", "opponent"):
        each = tallies[f"{side}_return"] / tallies["steps"]
        row[f"{side}_reward"] = float(tallies[f"{side}_return"].sum() / tallies["steps"].sum())
        row[f"{side}_sd"] = float(each.std(ddof=1)) if len(each) > 1 else 0.0
    row |= {name: found[name] for name in MEASURES}
    shown = window == FINAL or any(window in stage for stage in STAGES.values())
    row |= dict(zip(_HISTOGRAMS, histogram.tolist() if shown else ([], []), strict=True))
    flown = ([], []) if paths is None else paths.round().astype(int).reshape(2, -1).tolist()
    return row | dict(zip(_PATHS, flown, strict=True))


def windows_of(rounds: Iterable[tuple[int, np.void, np.ndarray]], budget: int) -> list[Row]:
    """The rows of a run's rounds; a window in which no round ended has none."""
    by_window: dict[int, list[tuple[np.void, np.ndarray]]] = {}
    for played, tally, histogram in rounds:
        window = min(WINDOWS * (played - 1) // budget, WINDOWS - 1)
        by_window.setdefault(window, []).append((tally, histogram))
    return [
        window_row(window, budget * (window + 1) // WINDOWS, by_window[window])
        for window in sorted(by_window)
    ]


_LARGEST = 2**28  # bytes of all lines; those of the committed files are a few million
_HEADS = {"condition": str, "seed": int, "about": dict, "columns": dict}


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        condition, seed: which.
        about: how it was made: scenario, budget, versions, seconds.
        rows: its windows in order; the last is without noise.
    """

    condition: str
    seed: int
    about: Mapping[str, Any]
    rows: list[Row]

    def line(self) -> str:
        """As JSON; numbers are kept to five digits, so that reading gives what was written."""
        columns = {name: [_rounded(row[name]) for row in self.rows] for name in COLUMNS}
        head = {"condition": self.condition, "seed": self.seed, "about": dict(self.about)}
        return json.dumps(head | {"columns": columns}, separators=(",", ":"))


class RunFile:
    """The file ``<folder>/<scenario>-<budget>.jsonl.gz``, which is only ever written whole.

    Args:
        folder: where it lies.
        preset, budget: the names of its scenario and budget.
    """

    def __init__(self, folder: Path, preset: str, budget: str) -> None:
        self.path = folder / f"{preset}-{budget}.jsonl.gz"

    def read(self) -> dict[tuple[str, int], Run]:
        """All runs, by condition and seed; none where there is no file.

        Raises:
            UserError: it cannot be read, was cut off, or a line is no run.
        """
        if not self.path.exists():
            return {}
        lines = read_bounded(self.path, "runs", _LARGEST).splitlines()
        runs = [self._run(number, line) for number, line in enumerate(lines, 1)]
        return {(run.condition, run.seed): run for run in runs}

    def add(self, runs: Iterable[Run]) -> None:
        """Put runs beside those that are there, or in their place."""
        every = self.read() | {(run.condition, run.seed): run for run in runs}
        text = "".join(every[key].line() + "\n" for key in sorted(every))
        write_whole(self.path, gzip.compress(text.encode(), mtime=0))

    def _run(self, number: int, line: bytes) -> Run:
        try:
            found = read_object(line)
            if wrong := [name for name, kind in _HEADS.items() if not isinstance(found.get(name), kind)]:
                raise ValueError(f"{wrong[0]} is missing or changed")
            columns = [found["columns"][name] for name in COLUMNS]
            rows = [
                dict(zip(COLUMNS, map(_read, COLUMNS, row), strict=True))
                for row in zip(*columns, strict=True)
            ]
        except (KeyError, ValueError, TypeError) as error:
            raise UserError(f"runs {self.path}: line {number} is no run: {error}") from error
        if not rows or rows[-1]["window"] != FINAL:
            raise UserError(f"runs {self.path}: line {number} is not whole")
        return Run(found["condition"], found["seed"], found["about"], rows)


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value


def _read(name: str, value: Any) -> Any:
    """A cell as the code expects it: lists of whole numbers, whole numbers, and numbers or None."""
    if name in LISTS:
        if not isinstance(value, list):
            raise ValueError(f"{name}: expected a list")
        return [int(number) for number in value]
    if name in ("window", "steps", "rounds"):
        return int(value)
    return None if value is None else float(value)


@dataclass(frozen=True)
class Results:
    """The runs of one scenario and budget.

    Attributes:
        runs: by condition and seed, the rows in the order of their windows; the last is without noise.
        about: the headings of the same runs.
    """

    runs: Mapping[str, Mapping[int, list[Row]]]
    about: Mapping[str, Mapping[int, Mapping[str, Any]]]

    def seeds(self, *conditions: str) -> list[int]:
        """The seeds that all of these conditions have, in order; none where one is missing."""
        sets = [set(self.runs.get(condition, {})) for condition in conditions]
        return sorted(set.intersection(*sets))

    def mean(self, condition: str, name: str, windows: Iterable[int], seeds: Iterable[int]) -> np.ndarray:
        """``(seeds,)``: the mean of a column over windows, each weighing as much as it has rounds."""
        wanted = set(windows)
        found = []
        for seed in seeds:
            rows = [row for row in self.runs[condition][seed] if row["window"] in wanted]
            found.append(np.average([row[name] for row in rows], weights=[row["rounds"] for row in rows]))
        return np.array(found)

    def level(self, condition: str, name: str, seeds: Iterable[int]) -> np.ndarray:
        """``(seeds,)``: a column late in training, where claims about levels are tested."""
        return self.mean(condition, name, STAGES["late"], seeds)

    def final(self, condition: str, name: str, seeds: Iterable[int]) -> np.ndarray:
        """``(seeds,)``: a column of the rounds that were played without noise after training."""
        return self.mean(condition, name, (FINAL,), seeds)

    def series(self, condition: str, name: str) -> np.ndarray:
        """``(seeds, windows)``: a column over training; NaN in a window in which no round ended."""
        found = np.full((len(self.runs[condition]), WINDOWS), np.nan)
        for line, seed in zip(found, sorted(self.runs[condition]), strict=True):
            for row in self.runs[condition][seed]:
                if row["window"] < WINDOWS and row[name] is not None:
                    line[row["window"]] = row[name]
        return found

    def histogram(self, condition: str, stage: str, seed: int) -> np.ndarray:
        """``(2, points)``: the steps per frequency point of both sides in a stage of Fig. 4."""
        rows = [row for row in self.runs[condition][seed] if row["window"] in STAGES[stage]]
        return np.sum([[row["ally_points"], row["jam_points"]] for row in rows], axis=0)

    def overlap(self, condition: str, stage: str, seeds: Iterable[int]) -> np.ndarray:
        """``(seeds,)``: the spectrum overlap of the two pooled distributions in a stage of Fig. 4."""
        found = [spectrum_overlap(self.histogram(condition, stage, seed)) for seed in seeds]
        return np.array(found, float)


def read_results(file: RunFile, wanted: Mapping[str, Iterable[int]]) -> Results:
    """The runs of a file, of those conditions and seeds that are wanted and there.

    Raises:
        UserError: a file that holds no runs.
    """
    there = file.read()
    found = [there[name, seed] for name, seeds in wanted.items() for seed in seeds if (name, seed) in there]
    runs: dict[str, dict[int, list[Row]]] = {}
    about: dict[str, dict[int, Mapping[str, Any]]] = {}
    for run in found:
        runs.setdefault(run.condition, {})[run.seed] = run.rows
        about.setdefault(run.condition, {})[run.seed] = run.about
    return Results(runs, about)
