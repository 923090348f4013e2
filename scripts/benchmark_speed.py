"""Speed of the game, as ratios to well-known environments measured in the same run.

    python scripts/benchmark_speed.py [--quick]

Absolute speeds depend on the machine and its load. So each speed is divided by that of a reference measured
in turn with it, and the median ratio is compared with a bound. One torch thread.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
import warnings
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import fpg_bench
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

ENV_ID = "FPG/AllyVsScripted-v0"
BATCH_GAMES, PPO_GAMES = 4096, 64


class Figure(NamedTuple):
    """A measured value, and the bound that it has to keep."""

    name: str
    value: float
    bound: float
    at_least: bool = True

    def __str__(self) -> str:
        is_reached = self.value >= self.bound if self.at_least else self.value <= self.bound
        bound = f"{'>=' if self.at_least else '<='} {self.bound:g}"
        return f"{self.name:46}  {self.value:9.2f}  {bound:>8}  {'reached' if is_reached else 'NOT reached'}"


def interleaved(repeats: int, **runs: Callable[[], float]) -> dict[str, np.ndarray]:
    """Return the rates of each function, called in turn, so that slow moments affect all of them."""
    rates = [[run() for run in runs.values()] for _ in range(repeats)]
    return dict(zip(runs, np.transpose(rates), strict=True))


def rate(step: Callable[[int], Any], steps: int) -> float:
    """Return the calls per second of a function of the number of the step, after a call that warms up."""
    step(0)
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


def vec_env_rate(env: VecEnv, steps: int, actions: np.ndarray | None = None) -> float:
    """Return the game steps per second of an SB3 environment, at random actions unless eight are given."""
    actions = random_actions(env.num_envs) if actions is None else actions
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


def ppo_rate(model: PPO, rollouts: int) -> float:
    """Return the steps per second of PPO, collecting and learning."""
    return PPO_GAMES * model.n_steps * rate(lambda number: model.learn(PPO_GAMES * model.n_steps), rollouts)


class Zeros(FPGVecEnv):
    """Environment without a game, which shows the costs of PPO itself."""

    def reset(self) -> np.ndarray:
        """Return observations of zeros."""
        return np.zeros((self.num_envs, OBSERVATION_SIZE), np.float32)

    def step_wait(self) -> Any:
        """Return zeros; no round ends."""
        rewards, dones = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        return self.reset(), rewards, dones, [{} for _ in range(self.num_envs)]


def stepping(quick: bool) -> list[Figure]:
    """Compare the batch of games and a single environment with CartPole."""
    repeats, batch_steps, steps = (1, 5, 200) if quick else (15, 290, 15_000)
    env = gymnasium.make(ENV_ID)
    single_rate(env, 2)  # compiles the scripted players
    rates = interleaved(
        repeats,
        one=partial(batch_rate, GameBatch(STANDARD, BATCH_GAMES, threads=1), batch_steps),
        cart_pole=partial(single_rate, gymnasium.make("CartPole-v1"), steps),
        two=partial(batch_rate, GameBatch(STANDARD, BATCH_GAMES, threads=2), batch_steps),
        single=partial(single_rate, env, steps),
    )
    ratios = {name: float(np.median(values / rates["cart_pole"])) for name, values in rates.items()}
    return [
        Figure("4096 games, one thread / CartPole-v1", ratios["one"], 20),
        Figure("4096 games, two threads / CartPole-v1", ratios["two"], 35),
        Figure("single environment / CartPole-v1", ratios["single"], 0.4),
    ]


def learning(quick: bool) -> list[Figure]:
    """Compare a batch of 64 games with 64 single environments, and PPO on it with PPO on zeros."""
    games = fpg_bench.make_sb3(ENV_ID, n_envs=PPO_GAMES, seed=0)
    singles = DummyVecEnv([lambda: gymnasium.make(ENV_ID)] * PPO_GAMES)
    repeats, steps = (1, 5) if quick else (15, 100)
    step = interleaved(
        repeats, games=partial(vec_env_rate, games, steps), singles=partial(vec_env_rate, singles, steps)
    )
    settings = {"n_steps": 32 if quick else 256, "batch_size": 2048, "n_epochs": 5, "seed": 0}
    models = [PPO("MlpPolicy", env, device="cpu", **settings) for env in (games, Zeros(games.core))]
    repeats, rollouts = (1, 1) if quick else (6, 2)
    ours, zeros = (partial(ppo_rate, model, rollouts) for model in models)
    ppo = interleaved(repeats, games=ours, zeros=zeros)
    return [
        Figure(
            "make_sb3, 64 games / 64 single environments",
            float(np.median(step["games"] / step["singles"])),
            4,
        ),
        Figure("PPO on make_sb3 / on zeros", float(np.median(ppo["games"] / ppo["zeros"])), 0.85),
    ]


def choosing(quick: bool) -> list[Figure]:
    """Compare choices from a list with the floats that they stand for, in the same games."""
    repeats, steps = (1, 5) if quick else (15, 200)
    figures = []
    for mode, count in product(("discrete", "multi-discrete"), (PPO_GAMES, 1024)):
        games = fpg_bench.make_sb3(ENV_ID, n_envs=count, seed=0, actions=mode)
        choices, seen = games.core.choices, np.zeros((count, OBSERVATION_SIZE), np.float32)
        games.action_space.seed(0)
        chosen = np.array([[games.action_space.sample() for _ in range(count)] for _ in range(8)])
        floats = np.array([choices.decode(each, seen) for each in chosen])
        plain = fpg_bench.make_sb3(ENV_ID, n_envs=count, seed=0)
        rates = interleaved(
            repeats,
            choices=partial(vec_env_rate, games, steps, chosen),
            floats=partial(vec_env_rate, plain, steps, floats),
        )
        ratio = float(np.median(rates["choices"] / rates["floats"]))
        figures.append(Figure(f"{count} games, {mode} / continuous", ratio, 0.9))
    return figures


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
        Figure("bytes per game", held / BATCH_GAMES, 2000, at_least=False),
        Figure("bytes allocated per step and game", allocated / BATCH_GAMES, 1, at_least=False),
    ]


def main() -> None:
    """Measure and print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a few steps, only to see that everything runs: speeds have no verdict",
    )
    quick = parser.parse_args().quick
    warnings.filterwarnings("ignore", module="stable_baselines3")
    torch.set_num_threads(1)
    for figure in (*stepping(quick), *memory(), *learning(quick), *choosing(quick)):
        is_timed = not figure.name.startswith("bytes")
        print(f"{figure.name}: runs" if quick and is_timed else figure, flush=True)


if __name__ == "__main__":
    main()
