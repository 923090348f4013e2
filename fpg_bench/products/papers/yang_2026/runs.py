"""Runs of a scenario and budget: a compressed file of JSON lines, and statistics of their columns."""

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
from fpg_bench.common.rows import Row
from fpg_bench.common.schema import Strict, parse
from fpg_bench.common.strict_json import read_object
from fpg_bench.game.metrics import measures, pool, spectrum_overlap
from fpg_bench.game.state import TALLY

WINDOWS = 40
FINAL = WINDOWS  # number of the row of rounds without noise after training
# Planned paths start afresh with each match of ten rounds, so stages have to consist of whole matches.
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
COLUMNS = ("window", "steps", "rounds", *_REWARDS, *MEASURES, *_HISTOGRAMS, *_PATHS)


def window_row(
    window: int, steps: int, rounds: Sequence[tuple[np.void, np.ndarray]], paths: np.ndarray | None = None
) -> Row:
    """Pool the rounds of a window into a row.

    Args:
        window: its number; :data:`FINAL` for the rounds without noise.
        steps: steps of the run at the end of the window.
        rounds: tally and histogram ``(2, points)`` of each round.
        paths: positions of both sides in a round, ``(2, n, 3)`` in m.

    Returns:
        A row with the keys :data:`COLUMNS`: rewards per step with their standard deviation over rounds,
        measures of the pooled rounds, the steps per frequency point (in the windows of Fig. 4 only), and the
        paths in whole metres, as a flat list of x, y and z.
    """
    tallies = np.array([tally for tally, _ in rounds], TALLY)
    histogram = np.sum([each for _, each in rounds], axis=0)
    pooled = measures(pool(tallies), histogram)
    row: Row = {"window": window, "steps": steps, "rounds": len(rounds)}
    for side in ("ally", "opponent"):
        rewards = tallies[f"{side}_return"] / tallies["steps"]
        row[f"{side}_reward"] = float(tallies[f"{side}_return"].sum() / tallies["steps"].sum())
        row[f"{side}_sd"] = float(rewards.std(ddof=1)) if len(rewards) > 1 else 0.0
    row |= {name: pooled[name] for name in MEASURES}
    has_histogram = window == FINAL or any(window in stage for stage in STAGES.values())
    row |= dict(zip(_HISTOGRAMS, histogram.tolist() if has_histogram else ([], []), strict=True))
    flat = ([], []) if paths is None else paths.round().astype(int).reshape(2, -1).tolist()
    return row | dict(zip(_PATHS, flat, strict=True))


def windows_of(rounds: Iterable[tuple[int, np.void, np.ndarray]], budget: int) -> list[Row]:
    """Return the rows of a run's rounds; windows in which no round ended have none."""
    by_window: dict[int, list[tuple[np.void, np.ndarray]]] = {}
    for played, tally, histogram in rounds:
        window = min(WINDOWS * (played - 1) // budget, WINDOWS - 1)
        by_window.setdefault(window, []).append((tally, histogram))
    return [
        window_row(window, budget * (window + 1) // WINDOWS, by_window[window])
        for window in sorted(by_window)
    ]


_MAX_BYTES = 2**28  # limit for a decompressed file


class RunAbout(Strict, extra="allow"):
    """Origin of a run; what earlier versions noted besides is kept.

    Attributes:
        scenario: preset and hash.
        versions: of the package and the libraries that trained it.
        seconds: duration.
        budget: name, steps and updates.
    """

    scenario: str
    versions: str
    seconds: int | float
    budget: str


class _StoredRun(Strict):
    """A line of a file."""

    condition: str
    seed: int
    about: RunAbout
    columns: dict[str, list[int | float | list[int] | None]]


@dataclass(frozen=True)
class PaperRun:
    """One run.

    Attributes:
        condition: name of its condition.
        seed: training seed.
        about: its origin.
        rows: its windows in order; the last one is without noise.
    """

    condition: str
    seed: int
    about: RunAbout
    rows: list[Row]

    def line(self) -> str:
        """Return the run as JSON, with numbers rounded to five digits."""
        columns = {name: [_rounded(row[name]) for row in self.rows] for name in COLUMNS}
        head = {"condition": self.condition, "seed": self.seed, "about": self.about.model_dump()}
        return json.dumps(head | {"columns": columns}, separators=(",", ":"))


class RunFile:
    """File of runs, ``<folder>/<scenario>-<budget>.jsonl.gz``, which is replaced atomically.

    Args:
        folder: its folder.
        preset: name of the scenario.
        budget: name of the budget.
    """

    def __init__(self, folder: Path, preset: str, budget: str) -> None:
        self.path = folder / f"{preset}-{budget}.jsonl.gz"

    def read(self) -> dict[tuple[str, int], PaperRun]:
        """Return all runs by condition and seed; none if there is no file.

        Raises:
            UserError: the file is unreadable or truncated, or a line is malformed.
        """
        if not self.path.exists():
            return {}
        lines = read_bounded(self.path, "runs", _MAX_BYTES).splitlines()
        runs = [self._run(number, line) for number, line in enumerate(lines, 1)]
        return {(run.condition, run.seed): run for run in runs}

    def add(self, runs: Iterable[PaperRun]) -> None:
        """Add runs, in place of earlier ones of the same condition and seed."""
        every = self.read() | {(run.condition, run.seed): run for run in runs}
        text = "".join(every[key].line() + "\n" for key in sorted(every))
        write_whole(self.path, gzip.compress(text.encode(), mtime=0))

    def _run(self, number: int, line: bytes) -> PaperRun:
        try:
            stored = parse(_StoredRun, read_object(line), f"runs {self.path}: line {number}")
            columns = [stored.columns[name] for name in COLUMNS]
            rows = [dict(zip(COLUMNS, row, strict=True)) for row in zip(*columns, strict=True)]
        except UserError:
            raise
        except (KeyError, ValueError) as error:
            raise UserError(f"runs {self.path}: line {number} is not a run: {error}") from error
        if not rows or rows[-1]["window"] != FINAL:
            raise UserError(f"runs {self.path}: line {number} is incomplete")
        return PaperRun(stored.condition, stored.seed, stored.about, rows)


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value


@dataclass(frozen=True)
class Runs:
    """Runs of one scenario and budget.

    Attributes:
        runs: runs by condition and seed.
    """

    runs: Mapping[str, Mapping[int, PaperRun]]

    def seeds(self, *conditions: str) -> list[int]:
        """Return the seeds that all of these conditions have, sorted; none if a condition is missing."""
        sets = [set(self.runs.get(condition, {})) for condition in conditions]
        return sorted(set.intersection(*sets))

    def mean(self, condition: str, name: str, windows: Iterable[int], seeds: Iterable[int]) -> np.ndarray:
        """Return the mean of a column over windows, weighted by their rounds, ``(seeds,)``."""
        wanted = set(windows)
        means = []
        for seed in seeds:
            rows = [row for row in self.runs[condition][seed].rows if row["window"] in wanted]
            means.append(np.average([row[name] for row in rows], weights=[row["rounds"] for row in rows]))
        return np.array(means)

    def level(self, condition: str, name: str, seeds: Iterable[int]) -> np.ndarray:
        """Return the mean of a column late in training, ``(seeds,)``."""
        return self.mean(condition, name, STAGES["late"], seeds)

    def final(self, condition: str, name: str, seeds: Iterable[int]) -> np.ndarray:
        """Return a column of the rounds without noise after training, ``(seeds,)``."""
        return self.mean(condition, name, (FINAL,), seeds)

    def series(self, condition: str, name: str) -> np.ndarray:
        """Return a column over training, ``(seeds, windows)``; NaN in windows in which no round ended."""
        values = np.full((len(self.runs[condition]), WINDOWS), np.nan)
        for index, seed in enumerate(sorted(self.runs[condition])):
            for row in self.runs[condition][seed].rows:
                if row["window"] < WINDOWS and row[name] is not None:
                    values[index, row["window"]] = row[name]
        return values

    def histogram(self, condition: str, stage: str, seed: int) -> np.ndarray:
        """Return the steps per frequency point of both sides in a stage of Fig. 4, ``(2, points)``."""
        rows = [row for row in self.runs[condition][seed].rows if row["window"] in STAGES[stage]]
        total: np.ndarray = np.array([[row[name] for name in _HISTOGRAMS] for row in rows]).sum(axis=0)
        return total

    def overlap(self, condition: str, stage: str, seeds: Iterable[int]) -> np.ndarray:
        """Return the overlap of both sides' pooled spectra in a stage of Fig. 4, ``(seeds,)``."""
        overlaps = [spectrum_overlap(self.histogram(condition, stage, seed)) for seed in seeds]
        return np.array(overlaps, float)


def read_results(file: RunFile, wanted: Mapping[str, Iterable[int]]) -> Runs:
    """Return the runs of a file with the wanted conditions and seeds, as far as they exist.

    Raises:
        UserError: an unreadable file.
    """
    stored = file.read()
    runs: dict[str, dict[int, PaperRun]] = {}
    for name, seeds in wanted.items():
        for seed in seeds:
            if (name, seed) in stored:
                runs.setdefault(name, {})[seed] = stored[name, seed]
    return Runs(runs)
