"""What it costs to let both sides learn, and to train against a frozen agent.

    python scripts/benchmark_both_sides.py [--quick] [--json FILE]

MADDPG's updates beside a bare torch loop of the same networks, batch, optimiser and buffer; PPO's steps
against a frozen agent beside the same against a script, 64 games at once; PPO's steps against 16 shipped
agents, one drawn per round, beside the same against a script, 128 games at once.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from benchmark_speed import Figure, interleaved, median_ratio, report
from stable_baselines3.common.logger import configure
from torch import nn

from fpg_bench.common.ids import DUEL
from fpg_bench.training.export import write_exported
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_games, make_model

AGAINST = "FPG/OpponentVsPolicy-v0"
POPULATION = [f"ally-scripted/{name}/seed_{seed}" for name in ("ppo", "sac", "td3") for seed in range(5)]
POPULATION.append("ally-scripted/ppo-stack8/seed_0")
SEEN, ACTS, BATCH, GAMMA, TAU = 15, 9, 32, 0.99, 0.01


def net(inputs: int, outputs: int, *last: nn.Module) -> nn.Sequential:
    """A network of the shipped size."""
    return nn.Sequential(
        nn.Linear(inputs, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, outputs), *last
    )


class Bare:
    """MADDPG's update for two players as a plain torch loop, with nothing around it."""

    def __init__(self, rows: int = 20_000) -> None:
        rng = np.random.default_rng(0)
        self.seen, self.then = (rng.uniform(-1, 1, (rows, 2 * SEEN)).astype(np.float32) for _ in range(2))
        self.did = rng.uniform(-1, 1, (rows, 2 * ACTS)).astype(np.float32)
        self.earned = rng.normal(size=(rows, 2)).astype(np.float32)
        self.actors, self.actors_then = ([net(SEEN, ACTS, nn.Tanh()) for _ in range(2)] for _ in range(2))
        self.critics, self.critics_then = ([net(2 * (SEEN + ACTS), 1) for _ in range(2)] for _ in range(2))
        self.adams = [
            torch.optim.Adam([w for part in parts for w in part.parameters()], lr=1e-3, fused=True)
            for parts in (self.critics, self.actors)
        ]
        self.rng = rng

    def update(self) -> None:
        """One update of all networks."""
        rows = self.rng.integers(0, len(self.seen), BATCH)
        seen, then, did, earned = (
            torch.from_numpy(kept[rows]) for kept in (self.seen, self.then, self.did, self.earned)
        )
        with torch.no_grad():
            next_acts = [
                actor(part) for actor, part in zip(self.actors_then, then.split(SEEN, 1), strict=True)
            ]
            joint = torch.cat((then, *next_acts), 1)
            wanted = earned + GAMMA * torch.cat([critic(joint) for critic in self.critics_then], 1)
        found = torch.cat([critic(torch.cat((seen, did), 1)) for critic in self.critics], 1)
        self._descend(0, ((found - wanted) ** 2).mean(0).sum())
        loss = torch.zeros(())
        acts = [actor(part) for actor, part in zip(self.actors, seen.split(SEEN, 1), strict=True)]
        for player, (mine, theirs) in enumerate(zip(acts, reversed(did.split(ACTS, 1)), strict=True)):
            both = (mine, theirs) if player == 0 else (theirs, mine)
            loss = loss - self.critics[player](torch.cat((seen, *both), 1)).mean()
        self._descend(1, loss)
        with torch.no_grad():
            for now, later in ((self.actors, self.actors_then), (self.critics, self.critics_then)):
                for one, other in zip(now, later, strict=True):
                    for weights, target in zip(one.parameters(), other.parameters(), strict=True):
                        target.mul_(1 - TAU).add_(weights, alpha=TAU)

    def _descend(self, which: int, loss: torch.Tensor) -> None:
        self.adams[which].zero_grad()
        loss.backward(inputs=self.adams[which].param_groups[0]["params"])
        self.adams[which].step()


def bare_rate(bare: Bare, updates: int) -> float:
    """Updates per second of the bare loop."""
    begin = time.perf_counter()
    for _ in range(updates):
        bare.update()
    return updates / (time.perf_counter() - begin)


def maddpg_rate(model: Any, updates: int) -> float:
    """Updates per second of MADDPG."""
    begin = time.perf_counter()
    model.train(updates, BATCH)
    return updates / (time.perf_counter() - begin)


def updating(quick: bool) -> list[Figure]:
    """MADDPG and the bare loop."""
    repeats, updates = (1, 5) if quick else (7, 1000)
    parameters = load_hyperparameters("maddpg", DUEL)
    model: Any = make_model("maddpg", make_games(DUEL, parameters, 0), parameters, 0)
    model.set_logger(configure(None, []))
    model.learn(5_000)  # fills the buffer, and has not updated yet
    runs: dict[str, Callable[[], float]] = {
        "maddpg": partial(maddpg_rate, model, updates),
        "bare": partial(bare_rate, Bare(), updates),
    }
    rates = interleaved(repeats, runs)
    return [Figure("MADDPG's updates / a bare torch loop's", median_ratio(rates, "maddpg", "bare"), 0.8)]


def ppo_rate(steps: int, ally: str | list[str], games: int = 64) -> float:
    """Steps per second of PPO against an ally, or several to draw from."""
    parameters = dataclasses.replace(load_hyperparameters("ppo", AGAINST), n_envs=games)
    model = make_model("ppo", make_games(AGAINST, parameters, 0, ally=ally), parameters, 0)
    begin = time.perf_counter()
    model.learn(steps)
    return model.num_timesteps / (time.perf_counter() - begin)


def frozen(quick: bool) -> list[Figure]:
    """PPO against a frozen agent, and against a script."""
    repeats, steps = (1, 8192) if quick else (5, 40 * 8192)
    with tempfile.TemporaryDirectory() as folder:
        view = "FPG/AllyVsScripted-v0"
        parameters = load_hyperparameters("ppo", view)
        told = {"algorithm": "ppo", "id": view, "training_seed": 0, "training_steps": 0, "scenario": ""}
        write_exported(make_model("ppo", make_games(view, parameters, 0), parameters, 0), Path(folder), told)
        runs: dict[str, Callable[[], float]] = {
            "agent": partial(ppo_rate, steps, folder),
            "script": partial(ppo_rate, steps, "expert"),
        }
        for rate in runs.values():
            rate()  # compiles, loads
        rates = interleaved(repeats, runs)
    ratio = median_ratio(rates, "agent", "script")
    return [Figure("PPO's steps against a frozen agent / against a script", ratio, 0.75)]


def population(quick: bool) -> list[Figure]:
    """PPO against 16 agents, and against a script."""
    repeats, steps = (1, 16_384) if quick else (5, 20 * 16_384)
    runs: dict[str, Callable[[], float]] = {
        "agents": partial(ppo_rate, steps, POPULATION, games=128),
        "script": partial(ppo_rate, steps, "expert", games=128),
    }
    for rate in runs.values():
        rate()  # compiles, loads
    ratio = median_ratio(interleaved(repeats, runs), "agents", "script")
    return [Figure("PPO's steps against 16 agents drawn per round / against a script", ratio, 0.8)]


def measure_all(quick: bool) -> list[Figure]:
    """All figures of this script."""
    return updating(quick) + frozen(quick) + population(quick)


if __name__ == "__main__":
    torch.set_num_threads(1)
    report(__doc__ or "", measure_all)
