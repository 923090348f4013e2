"""Gymnasium environment of one game."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import (
    Info,
    ResetOptions,
    SingleAgentGame,
    as_info,
    first_seeds,
    one_action,
    wants_new_match,
)
from fpg_bench.envs.screen import FRAMES_PER_SECOND, RENDER_MODES, Screen, offered_modes
from fpg_bench.game.scenario import LINK
from fpg_bench.game.spec import GameSpec

_OF_LINK = ("snr_db", "rate_mbit_s", "covered")  # in the info of each step of the model link


class FPGEnv(gymnasium.Env):
    """The frequency point game of one ally and one opponent; the agent plays one side.

    The ally keeps a radio link to its base station; the opponent finds the link's frequency and jams it.
    A step lasts one second.

    >>> import gymnasium
    >>> import fpg_bench
    >>> env = gymnasium.make("FPG/AllyVsScripted-v0", opponent="sweep")
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    >>> observation.shape, terminated
    ((15,), False)

    **Observation space**: ``Box(-1, 1, (15,), float32)``; see
    :func:`fpg_bench.envs.core.observation_space`. With ``observation="waterfall"`` the ally sees
    ``Box(-1, 1, (history, bins), float32)`` instead; see :class:`fpg_bench.game.waterfall.Waterfall`.

    **Action space**: ``Box(-1, 1, (9,), float32)``; see :func:`fpg_bench.envs.core.action_space`. Values
    beyond the bounds are clipped; NaN and infinity are refused. With ``actions="discrete"`` (and the ids
    ``FPG/...Discrete-v0``) ``Discrete(n)``, with ``"multi-discrete"`` ``MultiDiscrete``; see
    :class:`fpg_bench.game.choices.Choices`.

    **Rewards**: the ally's is its SNR above the threshold in dB, less what hopping and spreading cost
    (Eq. 5). The opponent's is the loss of SNR in dB that its jamming causes, plus a bonus within 30 m of
    the ally (Eq. 6). The option ``reward`` chooses others.

    **Starting state**: ``reset(seed=...)`` begins a match. ``reset()`` plays its next round, and after the
    last round the next match of the seed. ``options={"new_match": True}`` begins that match early.

    **Episode end**: a round is truncated after the scenario's ``steps_per_round``; it never terminates.

    **Info**: ``advice`` of the knowledge base for an ally that senses jamming, ``action_mask`` of the allowed
    choices where actions are discrete, in the radio model ``link`` ``snr_db``, ``rate_mbit_s`` and
    ``covered`` of the step (the truth, for logs and plots), and in a round's last step its ``measures``,
    without those that do not exist. No value is None.

    Args:
        env_id: one of the ids of :mod:`fpg_bench.common.ids`.
        render_mode: None or ``rgb_array``; ``gymnasium.make`` takes ``human``, too, and opens a window.
        threads: see :class:`fpg_bench.game.batch.GameBatch`.
        **options: attributes of :class:`fpg_bench.game.spec.GameSpec`.
    """

    _spec: EnvSpec | None = None
    metadata = {"render_modes": list(RENDER_MODES), "render_fps": FRAMES_PER_SECOND}  # noqa: RUF012

    def __init__(
        self, env_id: str, render_mode: str | None = None, threads: int | None = None, **options: Any
    ) -> None:
        self.core = SingleAgentGame(GameSpec.of(env_id, **options), 1, threads)
        self.metadata = {**self.metadata, "render_modes": list(offered_modes())}
        self.render_mode = render_mode
        self.observation_space, self.action_space = self.core.observation_space, self.core.action_space
        self._begun = False
        self._screen = Screen(self.core.duel.batch, render_mode)

    @property
    def game_spec(self) -> GameSpec:
        """The game, as :func:`fpg_bench.make_sb3` opens it again."""
        return self.core.game_spec

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification; ``max_episode_steps`` is a round's length."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = dataclasses.replace(spec, max_episode_steps=self.core.scenario.steps_per_round)
        self._spec = spec

    def reset(
        self, *, seed: int | None = None, options: ResetOptions | None = None
    ) -> tuple[np.ndarray, Info]:
        """Begin a round; see the class.

        Raises:
            UserError: a seed that is not a whole number in [0, 2^63), or an unknown option.
        """
        seeds = first_seeds(seed, 1) if seed is not None or not self._begun else None
        super().reset(seed=None if seed is None or seeds is None else int(seeds[0]))
        self.core.reset(seeds=seeds, new_match=wants_new_match(options))
        self._begun = True
        self._screen.record(begin=True)
        return self.core.observations[0].copy(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, Info]:
        """Play one step with an action: ``(9,)``, an array of floats or a list, or a choice.

        Raises:
            ActionError: a wrong shape or dtype, NaN or infinity (the message names the index), or a choice
                that is out of range or forbidden.
            UserError: the round is over or none was begun.
        """
        core = self.core
        actions = one_action(action, "action", core.choices)
        if not self._begun or core.truncated[0]:
            raise UserError("step: the round is over; call reset first")
        core.step(actions)
        self._screen.record()
        truncated = bool(core.truncated[0])
        return core.observations[0].copy(), float(core.rewards[0]), False, truncated, self._info()

    def _info(self) -> Info:
        core = self.core
        info: Info = {}
        if (advice := core.advice(0)) is not None:
            info["advice"] = advice
        if core.choices is not None:
            info["action_mask"] = core.choices.mask
        if core.scenario.snr_model == LINK[1]:
            game = core.duel.batch.games[0]
            info |= {name: game[name].item() for name in _OF_LINK}
        if core.truncated[0]:
            info["measures"] = as_info(core.measures(0))
        return info

    def action_masks(self) -> np.ndarray:
        """Return the allowed choices, ``(n,)`` bool; raises UserError where actions are continuous."""
        return self.core.action_masks()

    def measures(self) -> dict[str, float | None]:
        """Return the measures of the present round so far."""
        return self.core.measures(0)

    def render(self) -> np.ndarray | None:
        """Return the picture of the present step, ``(height, width, 3)`` uint8, in mode ``rgb_array``."""
        return self._screen.picture()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._screen.close()
