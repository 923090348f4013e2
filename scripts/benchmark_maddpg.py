"""Processor time of an update of MADDPG by torch and by JAX.

    python scripts/benchmark_maddpg.py [--quick] [--json FILE]

Networks, batches and hyper-parameters are those of the paper's experiment (two players, 64 x 64, batches of
32), with an update after each step as in Algorithm 1. An update samples its batch, learns from it, and
copies the actors back. Needs the extra ``fast``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from benchmark_speed import Figure, interleaved, median_ratio, report

from fpg_bench.envs.sb3_vec_env import make_sb3_duel
from fpg_bench.paper.experiment import ALGORITHM, BUDGETS, hyperparameters
from fpg_bench.training.maddpg import MADDPG
from fpg_bench.training.maddpg.jax_learner import JaxLearner
from fpg_bench.training.models import make_model

BUDGET = BUDGETS["paper"]
STEPS = 6400  # in the replay buffer when updates are measured
LEAST = 6.0  # JAX's updates per processor second, relative to torch's
LEARNERS = ("torch", "jax")


def updater(learner: str) -> Callable[[], None]:
    """Return a function that updates a model as often as after a step of all games."""
    games = make_sb3_duel(BUDGET.games, seed=0, scenario="paper")
    model: MADDPG = make_model(ALGORITHM, games, hyperparameters(BUDGET), 0)  # type: ignore[assignment]
    model.learning_starts = 2 * STEPS
    model.learn(STEPS)
    jax = JaxLearner([model]) if learner == "jax" else None

    def update() -> None:
        batches = model.replay_buffer.sample_many(BUDGET.gradient_steps, model.batch_size)
        if jax is None:
            model.update(batches)
        else:
            jax.learn([batches])
            jax.write_actors()

    update()  # compiles
    return update


def update_rate(update: Callable[[], None], calls: int) -> float:
    """Return the joint updates per second of the processor."""
    begin = time.process_time()
    for _ in range(calls):
        update()
    return calls * BUDGET.gradient_steps / (time.process_time() - begin)


def measure_all(quick: bool) -> list[Figure]:
    """Return all figures of this script."""
    repeats, calls = (1, 1) if quick else (9, 4)
    runs = {name: partial(update_rate, updater(name), calls) for name in LEARNERS}
    rates = interleaved(repeats, runs)
    figures = [Figure("updates, JAX / torch", median_ratio(rates, "jax", "torch"), None if quick else LEAST)]
    for name in LEARNERS:
        milliseconds = 1000 / float(np.median(rates[name]))
        figures.append(Figure(f"an update by {name}", milliseconds, None, unit="ms"))
    return figures


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
