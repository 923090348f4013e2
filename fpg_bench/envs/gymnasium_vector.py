"""Gymnasium vector environment: N games, which begin their next rounds by themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import (
    Info,
    ResetOptions,
    SingleAgentGame,
    as_info,
    first_seeds,
    staggered_horizons,
    wants_new_match,
)
from fpg_bench.game.spec import GameSpec

_MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class FPGVectorEnv(VectorEnv):
    """N games stepped at once; each plays as a single game of its seed does.

    Of one seed, game i plays a stream that is keyed by (seed, i), and game 0 the seed itself, so no other
    seed shares a game; a list has a seed for each game.

    Observations are ``(N, 15)`` float32, actions ``(N, 9)`` floats in [-1, 1] or ``(N,)`` choices, and
    rewards ``(N,)`` float64; their meanings are those of :class:`fpg_bench.envs.gymnasium_env.FPGEnv`.

    >>> import gymnasium
    >>> import fpg_bench
    >>> envs = gymnasium.make_vec("FPG/AllyVsScripted-v0", num_envs=64)
    >>> envs.reset(seed=0)[0].shape
    (64, 15)

    A round's last step has ``truncations`` set, and its infos hold ``measures``. With ``autoreset_mode``
    NEXT_STEP the step after it begins the next round, ignores that game's action and gives reward 0. With
    SAME_STEP the last step does so itself: its observation is the next round's first, and its infos hold
    ``final_obs`` and ``final_info``.

    Args:
        env_id: one of the ids of :mod:`fpg_bench.common.ids`.
        num_envs: number of games, N.
        stagger: cut the first rounds at evenly spread steps, so that the batch mixes phases.
        autoreset_mode: NEXT_STEP (``"NextStep"``) or SAME_STEP (``"SameStep"``).
        threads: see :class:`fpg_bench.game.batch.GameBatch`.
        **options: attributes of :class:`fpg_bench.game.spec.GameSpec`.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        stagger: bool = False,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise UserError(f"render_mode: a batch is not rendered, got {render_mode!r}; use gymnasium.make")
        mode = next((mode for mode in _MODES if autoreset_mode in (mode, mode.value)), None)
        if mode is None:
            known = " or ".join(repr(mode.value) for mode in _MODES)
            raise UserError(f"autoreset_mode: expected {known}, got {autoreset_mode!r}")
        self.autoreset_mode = mode  # Gymnasium's own vectors have it beside the metadata; TorchRL asks for it
        self._same_step = mode is AutoresetMode.SAME_STEP
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        self.core = SingleAgentGame(GameSpec.of(env_id, **options), num_envs, threads)
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = self.core.observation_space
        self.single_action_space = self.core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._stagger = stagger
        self._begun = False

    @property
    def game_spec(self) -> GameSpec:
        """The game, as :func:`fpg_bench.make_sb3` opens it again."""
        return self.core.game_spec

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: ResetOptions | None = None
    ) -> tuple[np.ndarray, Info]:
        """Begin a round in every game; seeds as in :class:`fpg_bench.envs.gymnasium_env.FPGEnv`."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        seeds = horizons = None
        if seed is not None or not self._begun:
            seeds = first_seeds(seed, self.num_envs)  # type: ignore[arg-type]  # refuses None in a list
        if self._stagger and not self._begun:
            horizons = staggered_horizons(self.num_envs, self.core.scenario.steps_per_round)
        self.core.reset(mask, seeds, wants_new_match(options), horizons)
        self._begun = True
        return self.core.observations.copy(), self._masks()

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Play one step with a batch of actions; see :meth:`fpg_bench.envs.core.SingleAgentGame.step`."""
        core = self.core
        over = core.truncated.copy()
        core.step(actions)
        if over.any():
            core.reset(over)
        truncated, rewards = core.truncated.copy(), core.rewards.copy()
        infos = self._masks()
        for game in np.flatnonzero(truncated).tolist():
            infos = self._add_info(infos, self._last_info(game), game)
        if self._same_step and truncated.any():
            core.reset(truncated)
        return core.observations.copy(), rewards, np.zeros(self.num_envs, bool), truncated, infos

    def _masks(self) -> Info:
        """Return the infos of a step: the allowed choices where actions are discrete."""
        if self.core.choices is None:
            return {}
        mask = self.core.choices.mask
        return {
            "action_mask": np.tile(mask, (self.num_envs, 1)),
            "_action_mask": np.ones(self.num_envs, bool),
        }

    def _last_info(self, game: int) -> Info:
        """Return the info of a game whose round is over."""
        info: Info = {"measures": as_info(self.core.measures(game))}
        if self._same_step:
            return {"final_obs": self.core.observations[game].copy(), "final_info": info}
        return info
