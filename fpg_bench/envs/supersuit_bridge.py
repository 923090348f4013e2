"""The bridge over SuperSuit: the PettingZoo environment as an SB3 ``VecEnv`` whose slots are agents.

For users of PettingZoo who want one policy to learn both sides. To train a single side at full speed, use
:func:`fpg_bench.make_sb3`.
"""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.common.extras import require_extra

require_extra("supersuit", "supersuit", "stable_baselines3")

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import supersuit
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from fpg_bench.common.checks import integer
from fpg_bench.envs.core import first_seeds
from fpg_bench.envs.pettingzoo_env import FPGParallelEnv, parallel_env
from fpg_bench.players.player import SIDES


class SuperSuitVecEnv(VecEnvWrapper):
    """Wrapper that fixes seeding, truncation handling and attribute access of SuperSuit's SB3 ``VecEnv``.

    Without it, ``seed`` and ``reset(seed=...)`` raise, every copy plays the same game, SB3 takes time limits
    for terminations, and attributes and methods of the games cannot be reached.

    Args:
        venv: result of ``supersuit.concat_vec_envs_v1(..., base_class="stable_baselines3")`` for copies
            of :class:`fpg_bench.envs.pettingzoo_env.FPGParallelEnv`, all in this process.
        seed: copies begin with matches as games of :func:`fpg_bench.make_sb3` do; None: random.
    """

    def __init__(self, venv: VecEnv, seed: int | None = None) -> None:
        self._concatenated: Any = venv.venv  # type: ignore[attr-defined]
        self.games: list[FPGParallelEnv] = [part.par_env for part in self._concatenated.vec_envs]
        super().__init__(venv)
        self._next_seeds: np.ndarray | None = first_seeds(seed, len(self.games))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next :meth:`reset`: each copy begins a new match of its own stream of the seed."""
        self._next_seeds = first_seeds(seed, len(self.games))
        return np.repeat(self._next_seeds, len(SIDES)).tolist()

    def reset(self) -> np.ndarray:
        """Begin a round in every copy."""
        seeds = [None] * len(self.games) if self._next_seeds is None else self._next_seeds.tolist()
        self._next_seeds = None
        parts = self._concatenated.vec_envs
        observations, infos = zip(
            *(part.reset(seed=seed) for part, seed in zip(parts, seeds, strict=True)), strict=True
        )
        self.reset_infos = list(itertools.chain(*infos))
        return np.concatenate(observations)

    def step_wait(self) -> VecEnvStepReturn:
        """Play the step; set ``TimeLimit.truncated`` at the end of a round."""
        observations, rewards, terminations, truncations, infos = self._concatenated.step_wait()
        for info, terminated, truncated in zip(infos, terminations, truncations, strict=True):
            if truncated:
                info["TimeLimit.truncated"] = not terminated
        return observations, rewards, (terminations | truncations).astype(bool), infos

    def has_attr(self, attr_name: str) -> bool:
        """Return True if the games have an attribute."""
        return VecEnv.has_attr(self, attr_name)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the game of each slot asked for."""
        return [getattr(self._game(slot), attr_name) for slot in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the game of each slot asked for."""
        for slot in self._get_indices(indices):
            setattr(self._game(slot), attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the game of each slot asked for."""
        slots = self._get_indices(indices)
        return [getattr(self._game(slot), method_name)(*method_args, **method_kwargs) for slot in slots]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for every slot: the games have no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def _game(self, slot: int) -> FPGParallelEnv:
        return self.games[slot // len(SIDES)]


def supersuit_vec_env(n_envs: int = 1, seed: int | None = None, **options: Any) -> VecMonitor:
    """Make an SB3 ``VecEnv`` of ``2 * n_envs`` slots over ``n_envs`` games: each slot is one agent.

    Slots alternate, ally (even) and opponent (odd), so **one policy learns and plays both sides**
    (parameter sharing, a form of self-play): both see 15 numbers and choose 9, whose meanings differ. A
    mean reward over the slots mixes both sides' rewards. To train one side alone, or two policies, use
    :func:`fpg_bench.make_sb3` or :func:`fpg_bench.make_duel`.

    >>> env = supersuit_vec_env(n_envs=2, seed=0)
    >>> env.num_envs, env.reset().shape
    (4, (4, 15))

    A round's end is a truncation: its info holds ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` and ``measures``.

    Args:
        n_envs: number of games.
        seed: games begin with matches as those of :func:`fpg_bench.make_sb3` do; None: random.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.

    Raises:
        UserError: an unknown option, a value out of range, or options that exclude each other.
    """
    integer(n_envs, "n_envs")
    copies = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(**options))
    venv = supersuit.concat_vec_envs_v1(copies, n_envs, base_class="stable_baselines3")
    return VecMonitor(SuperSuitVecEnv(venv, seed))
