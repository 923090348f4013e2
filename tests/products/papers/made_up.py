"""Artificial runs with a known outcome."""

import numpy as np

from fpg_bench.products.papers.yang_2026.conditions import (
    BASE,
    FIXED_PATHS,
    NO_KNOWLEDGE,
    NO_PLANNER,
    swapped,
)
from fpg_bench.products.papers.yang_2026.runs import COLUMNS, FINAL, WINDOWS, PaperRun, RunAbout, Runs

SEEDS = range(10)
LEVELS = dict.fromkeys(FIXED_PATHS, 5.0) | {"tone": 3.0, "narrowband": 6.0, "comb": 5.0, "broadband": 9.0}
LEVELS |= {BASE: 10.0, NO_PLANNER: 4.0, NO_KNOWLEDGE: 10.0}
LEVELS |= {swapped(BASE, path): 7.0 for path in FIXED_PATHS}


def run(condition: str, seed: int, levels: dict[str, float], rising: float) -> PaperRun:
    """Return a run with the condition's level as the opponent's reward, and falling overlap."""
    rng = np.random.default_rng([seed, len(condition)])
    rows = []
    for window in range(WINDOWS + 1):
        row = dict.fromkeys(COLUMNS, 0.0) | {"window": window, "rounds": 10}
        row["opponent_reward"] = levels[condition] + rng.normal(0, 0.1)
        row["ally_reward"] = (15.0 if condition == NO_KNOWLEDGE else 20.0) + rng.normal(0, 0.1)
        part = min(window, FINAL - 1) / WINDOWS
        row["overlap_ratio"] = 0.5 - rising * 0.2 * part + rng.normal(0, 0.01)
        row["jamming_success_rate"] = 0.1 + rising * 0.2 * part + rng.normal(0, 0.01)
        own = np.full(15, 100)
        own[window % 15] += 100
        own[0] += int(rising * 300 * part)
        row |= {"ally_points": own.tolist(), "jam_points": [100] * 15}
        rows.append(row)
    return PaperRun(
        condition, seed, RunAbout(scenario="made up", versions="made up", seconds=1, budget="made up"), rows
    )


def results(levels=LEVELS, rising=1.0, seeds=SEEDS) -> Runs:
    return Runs({name: {seed: run(name, seed, levels, rising) for seed in seeds} for name in levels})
