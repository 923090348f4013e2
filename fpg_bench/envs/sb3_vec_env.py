"""Stable-Baselines3 environments: a native ``VecEnv`` of N games, and the wrapper of a memory."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.common.extras import require_extra

require_extra("train", "stable_baselines3")

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnv,
    VecEnvIndices,
    VecEnvStepReturn,
    VecEnvWrapper,
)

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import (
    Info,
    JointGame,
    ResetOptions,
    SingleAgentGame,
    as_info,
    first_seeds,
    staggered_horizons,
    wants_new_match,
)
from fpg_bench.envs.screen import Screen
from fpg_bench.game.spec import GameSpec, OtherGame, game_product
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.players.memory import MEMORY_SIZES, remember


class FPGVecEnv(VecEnv):
    """N games as a ``VecEnv`` with same-step autoreset.

    Observations are ``(N, 15)`` float32, actions ``(N, 9)`` floats or choices from a list.

    The info of a round's last step holds ``terminal_observation``, ``TimeLimit.truncated`` and
    ``episode`` as ``Monitor`` writes it: ``r``, ``l``, ``t`` and all measures of the round. Every array
    handed out is a copy.

    Args:
        core: the games, of which the caller plays one side (:class:`fpg_bench.envs.core.SingleAgentGame`), or
            both, or a side of seats.
        seed: seed of the first matches; each game has a stream of its own
            (:func:`fpg_bench.game.batch.check_seeds`). None: random.
        stagger: cut the first rounds after seeding at evenly spread steps, so that a batch mixes phases.
        render_mode: None, or ``rgb_array`` to film the first game (``VecVideoRecorder``).
    """

    def __init__(
        self,
        core: SingleAgentGame | JointGame,
        seed: int | None = None,
        stagger: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise UserError(f"render_mode: expected None or 'rgb_array', got {render_mode!r}")
        self.core = core
        self.render_mode = render_mode
        self._screen = Screen(core.batch, render_mode)
        super().__init__(core.count, core.observation_space, core.action_space)
        self._stagger = stagger
        self._begun = self._new_match = False
        self._next_seeds = None if seed is None else first_seeds(seed, core.count)
        self._actions: Any = None
        self._start_time = time.time()

    @property
    def game_spec(self) -> GameSpec:
        """The game, as :func:`make_sb3` opens it again."""
        return self.core.game_spec

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next :meth:`reset`: each game begins a new match of its own stream of the seed."""
        self._next_seeds = first_seeds(seed, self.num_envs)
        return [int(s) for s in self._next_seeds]

    def set_options(self, options: list[ResetOptions] | ResetOptions | None = None) -> None:
        """Set the options of the next :meth:`reset`: ``{"new_match": True}``, for all games."""
        self._new_match = wants_new_match(next(iter(options), None) if isinstance(options, list) else options)

    def reset(self) -> np.ndarray:
        """Begin a round in every game."""
        seeds, horizons = self._next_seeds, None
        if seeds is None and not self._begun:
            seeds = first_seeds(None, self.num_envs)
        if self._stagger and seeds is not None:
            horizons = staggered_horizons(self.num_envs, self.core.scenario.steps_per_round)
        self.core.reset(seeds=seeds, new_match=self._new_match, horizons=horizons)
        self._begun, self._next_seeds, self._new_match = True, None, False
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._screen.record(begin=True)
        return self.core.observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions, ``(N, 9)`` floats or choices, for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Play the step; games whose round is over begin the next one at once."""
        core = self.core
        core.step(self._actions)
        rewards, dones = core.rewards.astype(np.float32), core.truncated.copy()
        infos: list[Info] = [{} for _ in range(self.num_envs)]
        if dones.any():
            for game in np.flatnonzero(dones).tolist():
                infos[game] = self._last_info(game)
            core.reset(dones)
        self._screen.record(begin=bool(dones[0]))
        return core.observations.copy(), rewards, dones, infos

    def _last_info(self, game: int) -> Info:
        measures = as_info(self.core.measures(game))
        episode = {
            "r": measures[f"{self.core.side}_return"],
            "l": self.core.length(game),
            "t": round(time.time() - self._start_time, 6),
        }
        return {
            "terminal_observation": self.core.observations[game].copy(),
            "TimeLimit.truncated": True,
            "episode": episode | measures,
        }

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return the picture of the first game, in mode ``rgb_array``."""
        return [self._screen.picture()]

    def close(self) -> None:
        """Close the screen of the first game."""
        self._screen.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the environment or of its core, once per game asked for."""
        value = getattr(self if hasattr(self, attr_name) else self.core, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the environment; it holds for all games at once.

        Raises:
            ValueError: fewer than all games are asked for.
        """
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"set_attr: {attr_name!r} can only be set for all {self.num_envs} games at once")
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``method_name(game, ...)`` of the core, for each game asked for: ``measures``, ``advice``."""
        method = getattr(self.core, method_name)
        return [method(game, *method_args, **method_kwargs) for game in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Return True for ``Monitor``, whose infos this environment writes itself."""
        return [issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]


class VecMemory(VecEnvWrapper):
    """Adds a side's memory to its observations; see :mod:`fpg_bench.players.memory`.

    >>> VecMemory(make_sb3("FPG/OpponentVsScripted-v0", n_envs=4)).reset().shape
    (4, 22)

    Args:
        venv: games of one side of the duel, or ``VecFrameStack`` on them.

    Raises:
        UserError: games of other observations.
    """

    def __init__(self, venv: VecEnv) -> None:
        core, shape = venv.get_attr("core")[0], venv.observation_space.shape
        if (of := core.observation_space).shape != (OBSERVATION_SIZE,) or shape is None:
            raise UserError(f"memory: needs the {OBSERVATION_SIZE} numbers of a side of the duel, got {of}")
        self.side: str = core.side
        self._past = np.zeros((venv.num_envs, MEMORY_SIZES[self.side]), np.float32)
        super().__init__(venv, spaces.Box(-1.0, 1.0, (shape[0] + self._past.shape[1],), np.float32))

    def reset(self) -> np.ndarray:
        """Begin rounds, of which nothing is remembered."""
        return self._remembered(self.venv.reset(), True)

    def step_wait(self) -> VecEnvStepReturn:
        """Play the step; a game whose round is over begins the next one with an empty memory."""
        seen, rewards, dones, infos = self.venv.step_wait()
        for game in np.flatnonzero(dones):
            last = infos[game]["terminal_observation"][None]
            infos[game]["terminal_observation"] = self._observed(last, self._past[[game]])[0]
        return self._remembered(seen, dones), rewards, dones, infos

    def _remembered(self, seen: Any, starts: np.ndarray | bool) -> np.ndarray:
        self._past[starts] = 0
        observed = self._observed(seen, self._past)
        self._past = observed[:, -self._past.shape[1] :].copy()
        return observed

    def _observed(self, seen: np.ndarray, past: np.ndarray) -> np.ndarray:
        return np.concatenate((seen, *remember(self.side, seen[:, -OBSERVATION_SIZE:], past)), axis=1)


def make_sb3(
    game: str | GameSpec,
    n_envs: int = 1,
    seed: int | None = None,
    stagger: bool = False,
    render_mode: str | None = None,
    threads: int | None = None,
    stacked: bool = False,
    **options: Any,
) -> FPGVecEnv:
    """Make a native SB3 ``VecEnv`` of N games.

    Observations are ``(N, 15)`` float32 or a waterfall, actions ``(N, 9)`` floats in [-1, 1] or choices from
    a list, rewards ``(N,)`` float32. Of ``FPG/duel_v0``, for
    :class:`fpg_bench.products.maddpg.maddpg.MADDPG`, they are ``(N, 30)``, ``(N, 18)`` and ``(N, 2)``, the
    ally's first.

    >>> env = make_sb3("FPG/AllyVsScripted-v0", n_envs=64, seed=0, opponent="sweep")
    >>> env.reset().shape
    (64, 15)
    >>> env.game_spec.to_dict()
    {'id': 'FPG/AllyVsScripted-v0', 'opponent': 'sweep'}

    Args:
        game: an environment id, or a specification.
        n_envs: number of games, N.
        seed: game i begins with a match of a stream keyed by (seed, i), game 0 with one of the seed itself,
            so no other seed shares a game; None: random.
        stagger: cut the first rounds after seeding at evenly spread steps, so that a batch mixes phases.
        render_mode: None, or ``rgb_array`` to film the first game (``VecVideoRecorder``).
        threads: see :class:`fpg_bench.game.batch.GameBatch`.
        stacked: compute trained rivals of equal layer sizes together, faster and equal to their ONNX policies
            to 1e-5, as ``fpg-bench train`` does; False: play them exactly as in evaluations.
        **options: attributes of :class:`fpg_bench.game.spec.GameSpec`, which replace those of ``game``, and
            ``allow``, the code that a game out of a file may name: see :meth:`GameSpec.of`.

    Raises:
        UserError: something unknown, out of range, or impossible together.
    """
    spec = GameSpec.of(game, **options)
    core: Any
    if isinstance(spec, OtherGame):
        core = game_product(spec.id).make_core(spec, n_envs)
    elif spec.is_duel:
        core = JointGame(spec, n_envs, threads)
    else:
        core = SingleAgentGame(spec, n_envs, threads, stacked)
    return FPGVecEnv(core, seed, stagger, render_mode)
