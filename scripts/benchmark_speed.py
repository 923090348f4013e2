"""CPU time of what somebody waits for: the games in a training, commands, and a result.

    python scripts/benchmark_speed.py [--quick]

``--quick`` takes half a minute: fewer repeats, no verdicts on speed, and nothing long. All times are CPU
seconds, which other work on the machine changes little. One torch thread.
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from command import run
from stable_baselines3.common.vec_env import VecEnvWrapper

import fpg_bench
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model

ROOT = Path(__file__).parents[1]
ENV_ID, AGAINST = "FPG/AllyVsScripted-v0", "FPG/AllyVsPolicy-v0"
RIVALS = tuple(f"suite:{name}" for name in ("training-1", "season-4", "season-5"))  # 39 in all
SEEDS = 5


class Figure(NamedTuple):
    """A measured value, and the bound that it has to keep."""

    name: str
    value: float
    bound: float

    def __str__(self) -> str:
        return f"{self.value_alone()}  {'reached' if self.value <= self.bound else 'NOT reached'}"

    def value_alone(self) -> str:
        """Return the line without its verdict."""
        return f"{self.name:46}  {self.value:9.2f}  <= {self.bound:g}"


def interleaved(repeats: int, **runs: Callable[[], float]) -> dict[str, np.ndarray]:
    """Return the rates of each function, called in turn, so that slow moments affect all of them."""
    rates = [[run() for run in runs.values()] for _ in range(repeats)]
    return dict(zip(runs, np.transpose(rates), strict=True))


class Timed(VecEnvWrapper):
    """Environment that adds up the CPU seconds of its steps."""

    seconds = 0.0

    def reset(self) -> Any:
        """Begin a round in every game."""
        return self.venv.reset()

    def step_wait(self) -> Any:
        """Play the step and add its time."""
        begin = time.process_time()
        result = self.venv.step_wait()
        self.seconds += time.process_time() - begin
        return result


def share(rollouts: int, env_id: str = ENV_ID, **options: Any) -> float:
    """Return the share of the environment in the CPU time of tuned PPO, in per cent."""
    parameters = load_hyperparameters("ppo", env_id)
    games = Timed(
        fpg_bench.make_sb3(env_id, parameters.n_envs, seed=0, stagger=True, stacked=True, **options)
    )
    model: Any = make_model("ppo", games, parameters, seed=0)
    model.learn(model.n_envs * model.n_steps)  # compiles
    games.seconds, begin = 0.0, time.process_time()
    model.learn(rollouts * model.n_envs * model.n_steps)
    return 100 * games.seconds / (time.process_time() - begin)


def child_seconds(*words: object, **variables: str) -> float:
    """Return the CPU seconds of a program, with these environment variables, and all that it starts."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, *map(str, words)]
    silent, environment = subprocess.DEVNULL, os.environ | variables
    subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=silent, stderr=silent)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def learning(quick: bool) -> list[Figure]:
    """Measure the share of the games in PPO's time."""
    shares = {
        "": partial(share),
        ", 39 trained rivals": partial(share, env_id=AGAINST, opponent=RIVALS, path="pursuit"),
        ", waterfall": partial(share, observation="waterfall"),
    }
    found = {
        name: float(np.median([run(1 if quick else 20) for _ in range(1 if quick else 3)]))
        for name, run in shares.items()
    }
    return [Figure(f"games in tuned PPO{name}, %", value, 10 if name else 5) for name, value in found.items()]


def waiting(quick: bool) -> list[Figure]:
    """Measure the CPU seconds of commands beside those of imports alone, which no command can be below."""
    repeats = 1 if quick else 5
    program = ("-m", "fpg_bench")
    verbs = ("zoo", "players", "suites")
    runs: dict[str, Any] = {verb: partial(child_seconds, *program, verb) for verb in verbs}
    floors = {
        "import fpg_bench, which registers ids": "import fpg_bench",
        "import torch, and a first optimizer": "import torch; torch.optim.Adam([torch.zeros(1)])",
    }
    runs |= {floor: partial(child_seconds, "-c", code) for floor, code in floors.items()}
    seconds = {verb: float(np.median(of)) for verb, of in interleaved(repeats, **runs).items()}
    make = f"import fpg_bench; games = fpg_bench.make_sb3({ENV_ID!r})"
    play = ("-c", f"{make}; games.reset(); games.step(games.action_space.sample()[None])")
    compiling = []
    if not quick:
        warm = child_seconds(*play)
        with tempfile.TemporaryDirectory() as folder:
            cold = child_seconds(*play, NUMBA_CACHE_DIR=folder)
        compiling = [Figure("CPU s of a first compilation of the game", cold - warm, 6)]
    bounds = {"zoo": 0.9, "players": 0.6, "suites": 0.6}
    return [
        *(Figure(f"CPU s of {floor}", seconds[floor], math.inf) for floor in floors),
        *(Figure(f"CPU s of fpg-bench {verb}", seconds[verb], bounds[verb]) for verb in bounds),
        *compiling,
    ]


def results() -> list[Figure]:
    """Measure the CPU seconds of a training, and from an installation to a table of five seeds."""
    program, train = ("-m", "fpg_bench"), ("train", "ppo-fast", ENV_ID)
    with tempfile.TemporaryDirectory() as folder:
        trained = child_seconds(*program, *train, "--steps", 2_000_000, "--out", Path(folder, "one"))
        runs = Path(folder, "runs")
        options = ("--steps", 400_000, "--seeds", f"0-{SEEDS - 1}", "--n-jobs", 1, "--out", runs)
        spent = child_seconds(*program, *train, *options)
        agents = [runs / f"seed_{seed}" / "agent" for seed in range(SEEDS)]
        out = Path(folder, "results")
        spent += child_seconds(*program, "evaluate", *agents, "--matches", 20, "--out", out)
        site = ("leaderboard", "build", "--out", Path(folder, "site"))
        child_seconds(*program, *site)
        again = child_seconds(*program, *site)
    return [
        Figure("CPU s of leaderboard build", again, 20),
        Figure("CPU s of train ppo-fast, 2,000,000 steps", trained, 15),
        Figure("CPU s from five seeds x 400,000 to a table", spent, 30),
    ]


def main(quick: bool = False) -> None:
    """Measure and print the figures."""
    warnings.filterwarnings("ignore", module="stable_baselines3")
    torch.set_num_threads(1)
    parts = [partial(kind, quick) for kind in (learning, waiting)]
    for part in parts if quick else [*parts, results]:
        for figure in part():
            print(figure.value_alone() if quick else figure, flush=True)


if __name__ == "__main__":
    run(main)
