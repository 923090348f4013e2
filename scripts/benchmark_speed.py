"""Speed of the game, as ratios to well-known environments measured in the same run.

    python scripts/benchmark_speed.py [--quick] [--json FILE]

Absolute speeds depend on the machine and its load. So each speed is divided by that of a reference measured
in turn with it, and the median ratio is compared with a bound. One torch thread.
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
from pettingzoo import ParallelEnv
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import fpg_bench
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

ENV_ID = "FPG/AllyVsScripted-v0"
BATCH_GAMES, PPO_GAMES = 4096, 64


class Figure(NamedTuple):
    """A measured value and its bound; None: for comparison only."""

    name: str
    value: float
    bound: float | None
    at_least: bool = True
    unit: str = "x"

    @property
    def is_reached(self) -> bool | None:
        """True if the value keeps its bound; None without a bound."""
        if self.bound is None:
            return None
        return self.value >= self.bound if self.at_least else self.value <= self.bound


Rates = dict[str, np.ndarray]


def interleaved(repeats: int, runs: dict[str, Callable[[], float]]) -> Rates:
    """Call each function ``repeats`` times, in turn, so that slow moments affect all of them."""
    rates: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            rates[name].append(run())
    return {name: np.array(values) for name, values in rates.items()}


def median_ratio(rates: Rates, name: str, reference: str) -> float:
    """Return the median over the repeats of one rate divided by another."""
    return float(np.median(rates[name] / rates[reference]))


def rate(step: Callable[[int], Any], steps: int) -> float:
    """Return the calls per second of a function of the number of the step."""
    begin = time.perf_counter()
    for number in range(steps):
        step(number)
    return steps / (time.perf_counter() - begin)


def random_actions(*shape: int) -> np.ndarray:
    """Return the actions of eight steps, ``(8, *shape, 9)``."""
    return np.random.default_rng(0).uniform(-1, 1, (8, *shape, ACTION_SIZE)).astype(np.float32)


def batch_rate(games: GameBatch, steps: int) -> float:
    """Return the game steps per second of a batch, both sides acting at random."""
    actions = random_actions(2, games.count)
    games.reset(seeds=0)
    games.step(*actions[0])  # compiles
    return games.count * rate(lambda number: games.step(*actions[number % 8]), steps)


def vec_env_rate(env: VecEnv, steps: int) -> float:
    """Return the game steps per second of an SB3 environment at random actions."""
    actions = random_actions(env.num_envs)
    env.reset()
    return env.num_envs * rate(lambda number: env.step(actions[number % 8]), steps)


def single_rate(env: gymnasium.Env[Any, Any], steps: int) -> float:
    """Return the steps per second of a Gymnasium environment at random actions, including resets."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)

    def step(number: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[number % 64])
        if terminated or truncated:
            env.reset()

    return rate(step, steps)


def parallel_rate(env: ParallelEnv[str, Any, Any], steps: int) -> float:
    """Return the joint steps per second of a PettingZoo environment at random actions, including resets."""
    actions = [{agent: env.action_space(agent).sample() for agent in env.possible_agents} for _ in range(64)]
    env.reset(seed=0)

    def step(number: int) -> None:
        env.step(actions[number % 64])
        if not env.agents:
            env.reset()

    return rate(step, steps)


def stepping(quick: bool) -> list[Figure]:
    """Compare the batch of games and the environments with well-known environments."""
    repeats, batch_steps, steps = (1, 5, 200) if quick else (15, 290, 15_000)
    env, cart_pole = gymnasium.make(ENV_ID), gymnasium.make("CartPole-v1")
    one, two = (GameBatch(STANDARD, BATCH_GAMES, threads) for threads in (1, 2))
    single_rate(env, 2)  # compiles the scripted players
    runs: dict[str, Callable[[], float]] = {
        "one thread": partial(batch_rate, one, batch_steps),
        "CartPole": partial(single_rate, cart_pole, steps),
        "two threads": partial(batch_rate, two, batch_steps),
        "single": partial(single_rate, env, steps),
        "adversary": partial(parallel_rate, simple_adversary_v3.parallel_env(), steps // 20),
        "duel": partial(parallel_rate, parallel_env(), steps),
    }
    rates = interleaved(repeats, runs)
    return [
        Figure("4096 games, one thread / CartPole-v1", median_ratio(rates, "one thread", "CartPole"), 20),
        Figure("4096 games, two threads / CartPole-v1", median_ratio(rates, "two threads", "CartPole"), 35),
        Figure("single environment / CartPole-v1", median_ratio(rates, "single", "CartPole"), 0.4),
        Figure("PettingZoo duel / mpe2 simple_adversary", median_ratio(rates, "duel", "adversary"), 8),
    ]


def memory() -> list[Figure]:
    """Measure the memory of a game, and what a step of all games allocates."""
    tracemalloc.start()
    games = GameBatch(STANDARD, BATCH_GAMES, threads=1)
    held = tracemalloc.get_traced_memory()[0]
    actions = np.zeros((2, BATCH_GAMES, ACTION_SIZE), np.float32)
    games.reset(seeds=0)
    games.step(*actions)
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for _ in range(100):
        games.step(*actions)
    allocated = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    return [
        Figure("memory per game", held / BATCH_GAMES, 2000, at_least=False, unit="B"),
        Figure("allocated per step and game", allocated / BATCH_GAMES, 1, at_least=False, unit="B"),
    ]


class Zeros(FPGVecEnv):
    """Environment without a game, which shows the costs of PPO itself."""

    def reset(self) -> np.ndarray:
        """Return observations of zeros."""
        return np.zeros((self.num_envs, OBSERVATION_SIZE), np.float32)

    def step_wait(self) -> Any:
        """Return zeros; no round ends."""
        rewards, dones = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        return self.reset(), rewards, dones, [{} for _ in range(self.num_envs)]


def ppo_rate(model: PPO, rollouts: int) -> float:
    """Return the steps per second of PPO, collecting and learning."""
    steps = rollouts * PPO_GAMES * model.n_steps
    begin = time.perf_counter()
    model.learn(steps)
    return steps / (time.perf_counter() - begin)


def learning(quick: bool) -> list[Figure]:
    """Compare PPO on a batch of 64 games, on 64 single environments, and on zeros."""
    ours = fpg_bench.make_sb3(ENV_ID, n_envs=PPO_GAMES, seed=0)
    singles = DummyVecEnv([lambda: gymnasium.make(ENV_ID)] * PPO_GAMES)
    envs: dict[str, VecEnv] = {"ours": ours, "singles": singles, "zeros": Zeros(ours.core)}
    models = {
        name: PPO(
            "MlpPolicy", env, n_steps=32 if quick else 256, batch_size=2048, n_epochs=5, seed=0, device="cpu"
        )
        for name, env in envs.items()
    }
    if not quick:
        interleaved(1, {name: partial(ppo_rate, model, 1) for name, model in models.items()})  # warm up
    repeats, rollouts = (1, 1) if quick else (5, 2)
    ppo = interleaved(repeats, {name: partial(ppo_rate, model, rollouts) for name, model in models.items()})
    repeats, steps = (1, 5) if quick else (15, 100)
    step = interleaved(repeats, {name: partial(vec_env_rate, env, steps) for name, env in envs.items()})
    return [
        Figure("stepping make_sb3 / 64 single environments", median_ratio(step, "ours", "singles"), 4),
        Figure("PPO on make_sb3 / on 64 single environments", median_ratio(ppo, "ours", "singles"), None),
        Figure("PPO on zeros / on 64 single environments", median_ratio(ppo, "zeros", "singles"), None),
        Figure("PPO on make_sb3 / on zeros", median_ratio(ppo, "ours", "zeros"), 0.85),
    ]


def import_seconds(module: str) -> float:
    """Return the seconds that a new process takes to import a module and exit."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", f"import {module}"], check=True)
    return time.perf_counter() - begin


def importing(quick: bool) -> list[Figure]:
    """Compare ``import fpg_bench`` with ``import gymnasium``."""
    runs = {module: partial(import_seconds, module) for module in ("gymnasium", "fpg_bench")}
    seconds = interleaved(1 if quick else 15, runs)
    difference = float(np.median(seconds["fpg_bench"] - seconds["gymnasium"]))
    return [Figure("import fpg_bench beyond import gymnasium", difference, 0.5, at_least=False, unit="s")]


def table(figures: list[Figure]) -> str:
    """Return the figures as aligned text."""
    rows = [("figure", "measured", "bound", "")]
    for figure in figures:
        bound = "-" if figure.bound is None else f"{'>=' if figure.at_least else '<='} {figure.bound:g}"
        verdict = {True: "reached", False: "NOT reached", None: "(comparison)"}[figure.is_reached]
        rows.append((figure.name, f"{figure.value:.2f} {figure.unit}", bound, verdict))
    widths = [max(len(cells[column]) for cells in rows) for column in range(3)]
    return "\n".join(
        f"{name:{widths[0]}}  {measured:>{widths[1]}}  {bound:>{widths[2]}}  {verdict}".rstrip()
        for name, measured, bound, verdict in rows
    )


def main() -> None:
    """Measure, print the table, and write it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few repeats, only to see that everything runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
    options = parser.parse_args()
    warnings.filterwarnings("ignore", module="stable_baselines3")
    torch.set_num_threads(1)
    quick = options.quick
    figures = [*stepping(quick), *memory(), *learning(quick), *importing(quick)]
    print(table(figures))
    if options.json:
        versions = {module.__name__: module.__version__ for module in (np, torch, gymnasium, fpg_bench)}
        machine = {"cpus": os.cpu_count(), "python": platform.python_version(), **versions}
        rows = [{**figure._asdict(), "is_reached": figure.is_reached} for figure in figures]
        options.json.write_text(json.dumps({"machine": machine, "figures": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
