"""Speed of training relative to SB3 alone, of exported agents, and of MADDPG's updates.

    python scripts/benchmark_training.py [--quick] [--json FILE]

Training is the complete call, with evaluations, checkpoints, TensorBoard log and export. It is compared with
SB3's ``learn`` on the same games, normalization and hyper-parameters. Agents and models act in 64 games at
once.

Updates of MADDPG by torch and by JAX are compared in processor time, with the networks and values of
the paper's experiment and an update after each step, as in its Algorithm 1. An update samples its batch,
learns from it, and copies the actors back. JAX needs the extra ``fast``.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_speed import VIEW, Figure, interleaved, median_ratio, report
from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.envs.sb3_vec_env import make_sb3_duel
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.paper.experiment import ALGORITHM, BUDGETS, hyperparameters
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.training.algorithms import ALGORITHMS
from fpg_bench.training.config import RunConfig
from fpg_bench.training.export import export_onnx
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.maddpg import MADDPG
from fpg_bench.training.maddpg.jax_learner import JaxLearner
from fpg_bench.training.models import make_games, make_model
from fpg_bench.training.train import train

BATCH = 64
BUDGET = BUDGETS["paper"]
STEPS = 6400  # in the replay buffer when updates are measured
LEARNERS = ("torch", "jax")


def new_model(algorithm: str) -> BaseAlgorithm:
    """Return an untrained model with the shipped hyper-parameters."""
    parameters = load_hyperparameters(algorithm, VIEW)
    return make_model(algorithm, make_games(VIEW, parameters, 0), parameters, 0)


def learn_rate(steps: int) -> float:
    """Return the steps per second of SB3's own ``learn``."""
    model = new_model("ppo")
    begin = time.perf_counter()
    model.learn(steps)
    return model.num_timesteps / (time.perf_counter() - begin)


def train_rate(steps: int) -> float:
    """Return the steps per second of ``train``, export included."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        train(RunConfig("ppo", VIEW, steps=steps), Path(folder) / "run", progress=False)
        return steps / (time.perf_counter() - begin)


def training(quick: bool) -> list[Figure]:
    """Compare PPO by ``train`` with SB3's ``learn``."""
    repeats, rollouts = (1, 1) if quick else (3, 122)  # 122: the shipped budget
    steps = rollouts * 64 * 256
    runs = {"train": train_rate, "learn": learn_rate}
    for rate in () if quick else runs.values():
        rate(64 * 256)  # compiles, loads
    rates = interleaved(repeats, {name: partial(rate, steps) for name, rate in runs.items()})
    least = None if quick else 0.9  # the export, done once, would dominate a short run
    return [Figure("PPO by fpg-bench train / by SB3's learn", median_ratio(rates, "train", "learn"), least)]


def predict_rate(player: Any, calls: int) -> float:
    """Return the calls per second of a player's ``predict`` on 64 games."""
    size = getattr(player, "observation_space", None)
    width = OBSERVATION_SIZE if size is None else size.shape[0]
    obs = np.random.default_rng(0).uniform(-1, 1, (BATCH, width)).astype(np.float32)
    state, starts = None, np.zeros(BATCH, bool)
    begin = time.perf_counter()
    for _ in range(calls):
        _, state = player.predict(obs, state, starts, deterministic=True)
    return calls / (time.perf_counter() - begin)


def playing(quick: bool) -> list[Figure]:
    """Compare every kind of shipped agent with its model."""
    repeats, calls = (1, 5) if quick else (7, 2000)
    figures = []
    for algorithm in ALGORITHMS:
        model = new_model(algorithm)
        players = {"agent": OnnxPlayer(export_onnx(model), {}), "model": model}
        rates = interleaved(repeats, {name: partial(predict_rate, p, calls) for name, p in players.items()})
        ratio = median_ratio(rates, "agent", "model")
        figures.append(Figure(f"{algorithm}: the agent's predict / the model's", ratio, 2))
    return figures


def updater(learner: str) -> Callable[[], None]:
    """Return a function that updates a model as often as after a step of all games."""
    games = make_sb3_duel(BUDGET.games, seed=0, scenario="paper")
    model: MADDPG = make_model(ALGORITHM, games, hyperparameters(BUDGET), 0)  # type: ignore[assignment]
    model.learning_starts = 2 * STEPS
    model.learn(STEPS)
    jax = JaxLearner(model) if learner == "jax" else None

    def update() -> None:
        batches = model.replay_buffer.sample_many(BUDGET.gradient_steps, model.batch_size)
        if jax is None:
            model.update(batches)
        else:
            jax.update(batches)
            jax.write_actors()

    update()  # compiles
    return update


def update_rate(update: Callable[[], None], calls: int) -> float:
    """Return the joint updates per second of the processor."""
    begin = time.process_time()
    for _ in range(calls):
        update()
    return calls * BUDGET.gradient_steps / (time.process_time() - begin)


def updating(quick: bool) -> list[Figure]:
    """Compare MADDPG's updates by JAX with those by torch."""
    repeats, calls = (1, 1) if quick else (9, 4)
    rates = interleaved(repeats, {name: partial(update_rate, updater(name), calls) for name in LEARNERS})
    figures = [Figure("updates, JAX / torch", median_ratio(rates, "jax", "torch"), None if quick else 6.0)]
    for name in LEARNERS:
        figures.append(Figure(f"an update by {name}", 1000 / float(np.median(rates[name])), None, unit="ms"))
    return figures


def measure_all(quick: bool) -> list[Figure]:
    """Return all figures of this script."""
    return playing(quick) + training(quick) + updating(quick)


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
