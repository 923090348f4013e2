"""Simulate boards and write the protocol's table on ranks: ``python scripts/simulate_ranks.py``."""

from __future__ import annotations

import numpy as np
from command import run
from lineage import ROOT, fill
from numpy.random import Generator

from fpg_bench.evaluation.statistics import differences, may_be_best, rank_ranges
from fpg_bench.evaluation.table import markdown_table

BOARDS, MATCHES = 1000, 80
COUNTS = (10, 20, 40, 60)  # of entries
SHARED, OWN = 7.0, 2.5  # standard deviations of scores of matches, as on the board: correlation 0.9
HEAD = ("entries", "differences covered %", "boards with a false *better* %", "best left out %")


def entry(rng: Generator, chance: np.ndarray, mean: float, is_wild: bool) -> np.ndarray:
    """Return the scores of an entry whose policies have this mean, ``(training seeds, matches)``."""
    seeds = int(rng.integers(2, 6))
    levels = rng.normal(0, 7, seeds)
    spread = np.full((seeds, 1), OWN)
    if is_wild:
        levels[0], spread[0] = -60, 30
    own = rng.normal(size=(seeds, len(chance))) + (rng.exponential(size=(seeds, len(chance))) - 1)
    return mean + (levels - levels.mean())[:, None] + chance + spread * own


def simulate(count: int, boards: int = BOARDS, seed: int = 0) -> tuple[float, float, float]:
    """Return the shares of differences that hold, of boards with a false "better", and of bests left out."""
    rng = np.random.default_rng(seed)
    covered, false, left_out = 0.0, 0, 0
    for _ in range(boards):
        chance = SHARED * rng.normal(size=MATCHES)
        samples = [entry(rng, chance, 0.0, k % 3 == 0) for k in range(count)]
        apart, half = differences(samples)
        covered += float((np.abs(apart) <= half)[np.triu_indices(count, 1)].mean())
        false += rank_ranges(samples) != [(1, count)] * count
        means = rng.normal(0, 2, count)
        unequal = [sample + mean for sample, mean in zip(samples, means, strict=True)]
        left_out += not may_be_best(unequal)[int(means.argmax())]
    return covered / boards, false / boards, left_out / boards


def main() -> None:
    """Write the table."""
    lines = [[str(count), *(f"{100 * share:.1f}" for share in simulate(count))] for count in COUNTS]
    fill(ROOT / "docs/benchmark/protocol.md", {"simulated ranks": markdown_table([HEAD, *lines])})


if __name__ == "__main__":
    run(main)
