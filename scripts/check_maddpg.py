"""MADDPG on a task that everybody knows, MPE's simple_spread with two agents: its returns while it learns.

python scripts/check_maddpg.py [--steps 500000] [--seeds 3]

A line per seed and tenth of the budget: steps, updates, and the mean return of an episode (25 steps, both
agents together) over 100 episodes played without noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from mpe2 import simple_spread_v3
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv

from fpg_bench.training.maddpg import MADDPG

EPISODES = 100


class Together(VecEnv):
    """Games of a PettingZoo parallel environment, all agents as one player; rewards ``(games, agents)``."""

    render_mode = None

    def __init__(self, games: int, seed: int) -> None:
        self._games = [
            simple_spread_v3.parallel_env(N=2, max_cycles=25, continuous_actions=True) for _ in range(games)
        ]
        self.agents = self._games[0].possible_agents
        seen, acts = (
            [space(agent) for agent in self.agents]
            for space in (self._games[0].observation_space, self._games[0].action_space)
        )
        self.sizes = tuple((o.shape[0], a.shape[0]) for o, a in zip(seen, acts, strict=True))
        super().__init__(games, _together(seen), _together(acts))
        self.seed(seed)

    def reset(self) -> np.ndarray:
        """Begin an episode in every game; the first ones are seeded."""
        return np.stack([self._begin(game) for game in range(self.num_envs)])

    def _begin(self, game: int) -> np.ndarray:
        found, _ = self._games[game].reset(seed=self._seeds[game])
        self._seeds[game] = None  # later episodes go on from there
        return self._joined(found)

    def _joined(self, found: dict[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([found[agent] for agent in self.agents])

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Play a step; an episode that is over is followed by the next one."""
        ends = np.cumsum([acts for _, acts in self.sizes])[:-1]
        seen, rewards, dones, infos = [], [], [], []
        for game, (env, row) in enumerate(zip(self._games, self._actions, strict=True)):
            acts = dict(zip(self.agents, np.split(row.astype(np.float32), ends), strict=True))
            found, reward, _, truncated, _ = env.step(acts)
            last, over = self._joined(found), all(truncated.values())
            infos.append({"terminal_observation": last, "TimeLimit.truncated": True} if over else {})
            seen.append(self._begin(game) if over else last)
            rewards.append([reward[agent] for agent in self.agents])
            dones.append(over)
        return np.stack(seen), np.array(rewards), np.array(dones), infos

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute, once per game."""
        return [getattr(self, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set it for all games."""
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """There is none."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """It never is."""
        return [False] * self.num_envs

    def close(self) -> None:
        """Let go of the games."""


def _together(parts: Sequence[Any]) -> spaces.Box:
    return spaces.Box(
        np.concatenate([part.low for part in parts]), np.concatenate([part.high for part in parts])
    )


def mean_return(model: MADDPG) -> float:
    """The mean over episodes of both agents' returns together, without noise."""
    games = Together(EPISODES, seed=10_000)
    seen, total = games.reset(), 0.0
    for _ in range(25):
        games.step_async(model.predict(seen, deterministic=True)[0])
        seen, rewards, _, _ = games.step_wait()
        total += float(rewards.sum())
    return total / EPISODES


def options(about: str) -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--steps", type=int, default=500_000)
    parser.add_argument("--seeds", type=int, default=3)
    return parser.parse_args()


def report(seed: int, steps: int, updates: int, found: float) -> None:
    """Print a line."""
    print(f"seed {seed}: {steps:9,} steps, {updates:8,} updates, return {found:8.2f}", flush=True)


def main() -> None:
    """Train, and print returns."""
    asked = options(__doc__.splitlines()[0])
    torch.set_num_threads(1)
    for seed in range(asked.seeds):
        games = Together(8, seed=1000 * seed)
        set_random_seed(seed)
        model = MADDPG(
            "JointPolicy",
            games,
            gamma=0.95,
            batch_size=256,
            gradient_steps=2,
            noise_sd=0.3,
            reward_scale=0.1,
            learning_starts=5000,
            policy_kwargs={"net_arch": [64, 64], "optimizer_kwargs": {"fused": True}},
        )
        model.action_space.seed(seed)
        report(seed, 0, 0, mean_return(model))
        for _ in range(10):
            model.learn(asked.steps // 10, reset_num_timesteps=False)
            report(seed, model.num_timesteps, model._n_updates, mean_return(model))


if __name__ == "__main__":
    main()
