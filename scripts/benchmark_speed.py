"""Speed of the game, as ratios to references measured in the same run.

    python scripts/benchmark_speed.py [--quick] [--json FILE]

Absolute speeds say little on another machine or beside another program, so every speed here is divided
by that of a well-known environment (or of nothing at all) measured right before or after it. Each pair is
repeated and the median of the ratios is shown, beside the ratio asked for. One torch thread.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
import tracemalloc
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from mpe2 import simple_adversary_v3
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import fpg_bench
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

VIEW = "FPG/AllyVsScripted-v0"
ARENA_GAMES = 4096
PPO_GAMES = 64
PPO_SETTINGS: dict[str, Any] = {"n_steps": 256, "batch_size": 2048, "n_epochs": 5, "device": "cpu"}


class Size(NamedTuple):
    """Amount of measurement: repeats of each pair, and steps per repeat."""

    repeats: int
    game_batch_steps: int
    single_steps: int
    batch_steps: int
    ppo_repeats: int
    ppo_rollouts: int


FULL = Size(
    repeats=15, game_batch_steps=290, single_steps=15_000, batch_steps=100, ppo_repeats=5, ppo_rollouts=2
)
QUICK = Size(repeats=1, game_batch_steps=5, single_steps=200, batch_steps=5, ppo_repeats=1, ppo_rollouts=1)


class Figure(NamedTuple):
    """A row of the table: a measured value and its bound (None: for comparison only)."""

    name: str
    value: float
    asked: float | None
    at_least: bool = True
    unit: str = "x"

    @property
    def reached(self) -> bool | None:
        """True if the value keeps its bound; None if it has none."""
        if self.asked is None:
            return None
        return self.value >= self.asked if self.at_least else self.value <= self.asked


def interleaved(repeats: int, runs: dict[str, Callable[[], float]]) -> dict[str, np.ndarray]:
    """Run each function ``repeats`` times, in turns, so that a slow moment affects them all."""
    found: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            found[name].append(run())
    return {name: np.array(values) for name, values in found.items()}


def median_ratio(rates: dict[str, np.ndarray], name: str, evaluator: str) -> float:
    """The median over the repeats of one rate divided by another."""
    return float(np.median(rates[name] / rates[evaluator]))


def game_batch_rate(game_batch: GameBatch, steps: int) -> float:
    """Return the game steps per second of a game batch with random actions of both sides."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (8, 2, game_batch.count, ACTION_SIZE)).astype(np.float32)
    game_batch.reset(seeds=0)
    game_batch.step(*actions[0])  # a first step, which may compile
    begin = time.perf_counter()
    for step in range(steps):
        game_batch.step(*actions[step % 8])
    return steps * game_batch.count / (time.perf_counter() - begin)


def single_rate(env: gymnasium.Env, steps: int) -> float:
    """Steps per second of one Gymnasium environment at random actions, resets included."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)
    begin = time.perf_counter()
    for step in range(steps):
        _, _, terminated, truncated, _ = env.step(actions[step % 64])
        if terminated or truncated:
            env.reset()
    return steps / (time.perf_counter() - begin)


def parallel_rate(env: Any, steps: int) -> float:
    """Joint steps per second of one PettingZoo parallel environment at random actions, resets included."""
    actions = [{agent: env.action_space(agent).sample() for agent in env.possible_agents} for _ in range(64)]
    env.reset(seed=0)
    begin = time.perf_counter()
    for step in range(steps):
        env.step(actions[step % 64])
        if not env.agents:
            env.reset()
    return steps / (time.perf_counter() - begin)


def stepping(size: Size) -> list[Figure]:
    """Compare the game batch and both environments with well-known environments."""
    cart_pole, view = gymnasium.make("CartPole-v1"), gymnasium.make(VIEW)
    one, two = (GameBatch(STANDARD, ARENA_GAMES, threads) for threads in (1, 2))
    single_rate(view, 2)  # compiles the scripted players
    runs: dict[str, Callable[[], float]] = {
        "one thread": partial(game_batch_rate, one, size.game_batch_steps),
        "CartPole": partial(single_rate, cart_pole, size.single_steps),
        "two threads": partial(game_batch_rate, two, size.game_batch_steps),
        "view": partial(single_rate, view, size.single_steps),
        "adversary": partial(parallel_rate, simple_adversary_v3.parallel_env(), size.single_steps // 20),
        "duel": partial(parallel_rate, parallel_env(), size.single_steps),
    }
    rates = interleaved(size.repeats, runs)
    return [
        Figure("arena, one thread / CartPole-v1", median_ratio(rates, "one thread", "CartPole"), 20),
        Figure("arena, two threads / CartPole-v1", median_ratio(rates, "two threads", "CartPole"), 35),
        Figure("one Gymnasium view / CartPole-v1", median_ratio(rates, "view", "CartPole"), 0.4),
        Figure("PettingZoo duel / mpe2 simple_adversary", median_ratio(rates, "duel", "adversary"), 8),
    ]


def memory() -> list[Figure]:
    """Measure the memory of a game, and the allocation of a step (for all games together)."""
    tracemalloc.start()
    game_batch = GameBatch(STANDARD, ARENA_GAMES, threads=1)
    held = tracemalloc.get_traced_memory()[0]
    actions = np.zeros((2, ARENA_GAMES, ACTION_SIZE), np.float32)
    game_batch.reset(seeds=0)
    game_batch.step(*actions)
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for _ in range(100):
        game_batch.step(*actions)
    allocated = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    return [
        Figure("memory a game", held / ARENA_GAMES, 2000, at_least=False, unit="B"),
        Figure("allocated in a step a game", allocated / ARENA_GAMES, 1, at_least=False, unit="B"),
    ]


class Zeros(FPGVecEnv):
    """The batched environment without a game, to measure PPO itself."""

    def reset(self) -> np.ndarray:
        """Observations of zeros."""
        return np.zeros((self.num_envs, OBSERVATION_SIZE), np.float32)

    def step_wait(self) -> Any:
        """Zeros, and no round that ends."""
        rewards, dones = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        return self.reset(), rewards, dones, [{} for _ in range(self.num_envs)]


def batch_rate(env: VecEnv, steps: int) -> float:
    """Steps per second of an SB3 environment at random actions."""
    actions = np.random.default_rng(0).uniform(-1, 1, (64, env.num_envs, ACTION_SIZE)).astype(np.float32)
    env.reset()
    begin = time.perf_counter()
    for step in range(steps):
        env.step(actions[step % 64])
    return steps * env.num_envs / (time.perf_counter() - begin)


def ppo_rate(model: PPO, rollouts: int) -> float:
    """Steps per second of PPO, collecting and learning."""
    steps = rollouts * PPO_GAMES * model.n_steps
    begin = time.perf_counter()
    model.learn(steps)
    return steps / (time.perf_counter() - begin)


def learning(size: Size) -> list[Figure]:
    """Compare PPO on 64 batched games, the same games one by one, and no game at all."""
    settings = PPO_SETTINGS if size is FULL else PPO_SETTINGS | {"n_steps": 32}
    ours = fpg_bench.make_sb3(VIEW, n_envs=PPO_GAMES, seed=0)
    singles = DummyVecEnv([lambda: gymnasium.make(VIEW)] * PPO_GAMES)
    envs: dict[str, VecEnv] = {"ours": ours, "singles": singles, "zeros": Zeros(ours.core)}
    models = {name: PPO("MlpPolicy", env, seed=0, **settings) for name, env in envs.items()}
    if size is FULL:
        interleaved(1, {name: partial(ppo_rate, model, 1) for name, model in models.items()})  # warm up
    ppo = interleaved(
        size.ppo_repeats,
        {name: partial(ppo_rate, model, size.ppo_rollouts) for name, model in models.items()},
    )
    batch = interleaved(
        size.repeats, {name: partial(batch_rate, env, size.batch_steps) for name, env in envs.items()}
    )
    return [
        Figure("stepping make_sb3 / 64 single views", median_ratio(batch, "ours", "singles"), 4),
        Figure("PPO on make_sb3 / on 64 single views", median_ratio(ppo, "ours", "singles"), None),
        Figure("PPO on zeros / on 64 single views", median_ratio(ppo, "zeros", "singles"), None),
        Figure("PPO on make_sb3 / on zeros", median_ratio(ppo, "ours", "zeros"), 0.85),
    ]


def import_seconds(module: str) -> float:
    """Return the time in s of a fresh process that imports a module."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", f"import {module}"], check=True)
    return time.perf_counter() - begin


def importing(size: Size) -> list[Figure]:
    """Measure the time of ``import fpg_bench`` beyond that of ``import gymnasium``."""
    modules = ("gymnasium", "fpg_bench")
    seconds = interleaved(size.repeats, {module: partial(import_seconds, module) for module in modules})
    beyond = float(np.median(seconds["fpg_bench"] - seconds["gymnasium"]))
    return [Figure("import fpg_bench beyond import gymnasium", beyond, 0.5, at_least=False, unit="s")]


def row(figure: Figure) -> tuple[str, str, str, str]:
    """A figure as the cells of the table."""
    bound = "-" if figure.asked is None else f"{'>=' if figure.at_least else '<='} {figure.asked:g}"
    verdict = {True: "reached", False: "NOT reached", None: "(comparison)"}[figure.reached]
    return figure.name, f"{figure.value:.2f} {figure.unit}", bound, verdict


def table(figures: list[Figure]) -> str:
    """The figures as aligned text."""
    rows = [("figure", "measured", "asked for", ""), *map(row, figures)]
    widths = [max(len(cells[column]) for cells in rows) for column in range(3)]
    return "\n".join(
        f"{name:{widths[0]}}  {measured:>{widths[1]}}  {bound:>{widths[2]}}  {verdict}".rstrip()
        for name, measured, bound, verdict in rows
    )


def machine() -> dict[str, Any]:
    """Return the machine and the versions."""
    versions = {module.__name__: module.__version__ for module in (np, torch, gymnasium, fpg_bench)}
    return {"cpus": os.cpu_count(), "python": platform.python_version(), **versions}


def report(about: str, measure: Callable[[bool], list[Figure]]) -> None:
    """Measure (hardly, where ``--quick`` is said), print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="hardly measure: does everything run?")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there as well")
    arguments = parser.parse_args()
    warnings.filterwarnings("ignore", module="stable_baselines3")
    torch.set_num_threads(1)
    figures = measure(arguments.quick)
    print(table(figures))
    if arguments.json:
        rows = [{**figure._asdict(), "reached": figure.reached} for figure in figures]
        arguments.json.write_text(json.dumps({"machine": machine(), "figures": rows}, indent=2) + "\n")


def measure_all(quick: bool) -> list[Figure]:
    """All figures of this script."""
    size = QUICK if quick else FULL
    return stepping(size) + memory() + learning(size) + importing(size)


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
