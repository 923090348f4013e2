"""The runs of an experiment: one series or one number a seed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.game.measures import spectrum_overlap
from fpg_bench.reproduce.runs import RunFile
from fpg_bench.reproduce.windows import FINAL, STAGES, WINDOWS, Row


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
