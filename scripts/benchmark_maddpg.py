"""What an update of MADDPG costs by each learner, torch's and JAX's, and what it leaves for the games.

    python scripts/benchmark_maddpg.py [--quick] [--json FILE]

Networks, batches and hyper-parameters are those of the paper's experiment (two players, 64 x 64, batches of
32), with an update after each step as in Algorithm 1. An update is drawing its batch, learning from it, and
handing the actors back. Both learners take turns. What counts is the processor's time, all threads together.
Needs the extra ``fast``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from benchmark_speed import Figure, interleaved, median_ratio, report

from fpg_bench.envs.sb3 import make_sb3_duel
from fpg_bench.reproduce.experiment import ALGORITHM, BUDGETS, hyperparameters
from fpg_bench.training.maddpg import MADDPG
from fpg_bench.training.maddpg_seeds import LEARNERS, find_learner
from fpg_bench.training.models import make_model

BUDGET = BUDGETS["paper"]
SEEN = 6400  # steps that a buffer holds when updates are measured
ASKED = {10: 3, 1: 6}  # how many times as many updates of so many models at once


def some_models(count: int) -> dict[int, MADDPG]:
    """New models by their seeds, each in its own games."""
    words, games = hyperparameters(BUDGET), BUDGET.games
    return {  # type: ignore[return-value]
        seed: make_model(ALGORITHM, make_sb3_duel(games, seed=seed, scenario="paper"), words, seed)
        for seed in range(count)
    }


def updater(learner: str, count: int) -> Callable[[], None]:
    """What updates models that have played at random a while, as often as after a step of all games."""
    models = list(some_models(count).values())
    for model in models:
        model.learning_starts = 2 * SEEN
        model.learn(SEEN)
    learning = find_learner(learner)(models)

    def update() -> None:
        times, size = BUDGET.gradient_steps, models[0].batch_size
        learning.learn([model.replay_buffer.sample_many(times, size) for model in models])  # type: ignore[union-attr]
        learning.write_actors()

    update()  # compiles
    return update


def update_rate(update: Callable[[], None], calls: int) -> float:
    """Joint updates per second of the processor."""
    begin = time.process_time()
    for _ in range(calls):
        update()
    return calls * BUDGET.gradient_steps / (time.process_time() - begin)


def updating(quick: bool) -> list[Figure]:
    """Updates alone, of ten models at once and of one."""
    repeats, calls = (1, 1) if quick else (9, 4)
    figures = []
    for count, asked in ASKED.items():
        runs = {name: partial(update_rate, updater(name, count), calls) for name in LEARNERS}
        rates = interleaved(repeats, runs)
        ratio = median_ratio(rates, "jax", "torch")
        figures.append(Figure(f"updates of {count}, JAX / torch", ratio, None if quick else asked))
        for name in LEARNERS:
            milliseconds = 1000 / float(np.median(rates[name]))
            figures.append(Figure(f"an update of {count} by {name}", milliseconds, None, unit="ms"))
    return figures


def measure_all(quick: bool) -> list[Figure]:
    """All figures of this script."""
    return updating(quick)


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
