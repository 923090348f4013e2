"""Speed of training relative to SB3 alone, and of exported agents relative to their models.

    python scripts/benchmark_training.py [--quick] [--json FILE]

Training is the complete call, with evaluations, checkpoints, TensorBoard log and export. It is compared with
SB3's ``learn`` on the same games, normalization and hyper-parameters. Agents and models act in 64 games at
once.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_speed import VIEW, Figure, interleaved, median_ratio, report
from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.training.algorithms import ALGORITHMS
from fpg_bench.training.config import RunConfig
from fpg_bench.training.export import export_onnx
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_games, make_model
from fpg_bench.training.train import train

BATCH = 64


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


def measure_all(quick: bool) -> list[Figure]:
    """Return all figures of this script."""
    return playing(quick) + training(quick)


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
