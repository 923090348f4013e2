"""PettingZoo environments: both sides of one game, moving at once or in turns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import OrderEnforcingWrapper
from pettingzoo.utils.conversions import parallel_to_aec

from fpg_bench.common.checks import mapping
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL, plain_id
from fpg_bench.envs.core import (
    Info,
    ResetOptions,
    action_space,
    as_info,
    first_seeds,
    observation_space,
    one_action,
)
from fpg_bench.envs.screen import FRAMES_PER_SECOND, RENDER_MODES, Screen, offered_modes
from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.choices import Choices
from fpg_bench.game.full_state import FULL_STATE_SIZE
from fpg_bench.game.spec import GameSpec, game_product
from fpg_bench.players.player import SIDES

_Observations = dict[str, np.ndarray]  # by agent, as the infos
_Infos = dict[str, Info]


class SeededParallelEnv(ParallelEnv):  # type: ignore[misc, unused-ignore]
    """Base class of parallel environments of one game: the agents' spaces, and rounds that begin with seeds.

    Args:
        observation_spaces, action_spaces: of all possible agents, by their names.
    """

    def __init__(
        self, observation_spaces: dict[str, spaces.Box], action_spaces: dict[str, spaces.Space[Any]]
    ) -> None:
        self.observation_spaces, self.action_spaces = observation_spaces, action_spaces
        self.possible_agents = list(action_spaces)
        self.agents: list[str] = []
        self.np_random = np.random.default_rng()  # for wrappers, as SuperSuit's frame_skip
        self._begun = False

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's observations, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions, always the same object."""
        return self.action_spaces[agent]

    def _after_the_end(
        self, actions: object
    ) -> tuple[_Observations, dict[str, float], dict[str, bool], dict[str, bool], _Infos]:
        """Return a step of nobody, which PettingZoo allows once no agent is left, as ``black_death_v3`` asks.

        Raises:
            UserError: there are actions, or no round was begun.
        """
        if actions or not self._begun:
            raise UserError("step: the round is over; call reset first")
        return {}, {}, {}, {}, {}

    def _begin(self, reset: Callable[..., object], seed: int | None, options: ResetOptions | None) -> None:
        """Begin a round by a game's ``reset``: a new match of a seed, or the next round."""
        seeds = first_seeds(seed, 1) if seed is not None or not self._begun else None
        # PettingZoo's own tests hand over options of no meaning, so unknown ones pass here
        reset(seeds=seeds, new_match=bool((options or {}).get("new_match", False)))
        if seed is not None and seeds is not None:
            self.np_random = np.random.default_rng(int(seeds[0]))
        self._begun = True


class FPGParallelEnv(SeededParallelEnv):
    """One game with the agents ``ally`` and ``opponent``, both played by the caller.

    Each agent has the observation space ``Box(-1, 1, (15,), float32)``, the action space
    ``Box(-1, 1, (9,), float32)`` and its own reward. Their meanings, seeds, rounds and matches are those of
    :class:`fpg_bench.envs.gymnasium_env.FPGEnv`. ``state()`` is the full state ``(54,)`` float32.

    >>> env = FPGParallelEnv(path="circle")
    >>> observations, infos = env.reset(seed=0)
    >>> actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    >>> observations, rewards, terminations, truncations, infos = env.step(actions)
    >>> sorted(rewards)
    ['ally', 'opponent']

    With ``actions="discrete"`` or ``"multi-discrete"`` both agents choose from lists, with a mapping from
    agents to action modes those that it names. Their infos have ``action_mask`` as ``sample`` of their
    action space takes it: int8, in mode ``multi-discrete`` a tuple of one array per list.

    Args:
        render_mode: None or ``rgb_array``.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.
    """

    metadata = {  # noqa: RUF012
        "name": "duel_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": FRAMES_PER_SECOND,
        "is_parallelizable": True,
    }

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        self.duel = make_duel(1, **options)
        self.metadata = {**self.metadata, "render_modes": list(offered_modes())}
        self.render_mode = render_mode
        super().__init__(
            {side: observation_space() for side in SIDES},
            {side: action_space(self.duel.choices[side]) for side in SIDES},
        )
        self.state_space = spaces.Box(-1.0, 1.0, (FULL_STATE_SIZE,), np.float32)
        self._screen = Screen(self.duel.batch, render_mode)

    @property
    def game_spec(self) -> GameSpec | None:
        """The game, as :func:`fpg_bench.make_duel` opens it again."""
        return self.duel.game_spec

    def reset(
        self, seed: int | None = None, options: ResetOptions | None = None
    ) -> tuple[_Observations, _Infos]:
        """Begin a round."""
        self._begin(self.duel.reset, seed, options)
        self.agents = list(SIDES)
        self._screen.record(begin=True)
        return self._observations(), self._infos()

    def step(
        self, actions: dict[str, np.ndarray]
    ) -> tuple[_Observations, dict[str, float], dict[str, bool], dict[str, bool], _Infos]:
        """Play one step with both sides' actions, ``(9,)`` or a choice.

        Raises:
            ActionError: a side's action is missing, of a wrong shape or dtype, holds NaN or infinity, or is
                a choice that is out of range or forbidden.
        """
        if not self.agents:
            return self._after_the_end(actions)
        batch = self.duel.batch
        choices = self.duel.choices
        given = mapping(actions, "step: actions by agent")
        ally, opponent = (one_action(given.get(side), side, choices[side]) for side in SIDES)
        batch.step(self.duel.decode("ally", ally), self.duel.decode("opponent", opponent))
        self._screen.record()
        over = bool(batch.games["truncated"][0])
        if over:
            self.agents = []
        rewards = {side: float(batch.games[f"{side}_reward"][0]) for side in SIDES}
        infos = self._infos()
        for info in infos.values() if over else ():
            info["measures"] = as_info(self.duel.measures(0))
        return self._observations(), rewards, dict.fromkeys(SIDES, False), dict.fromkeys(SIDES, over), infos

    def _observations(self) -> _Observations:
        batch = self.duel.batch
        return {"ally": batch.ally_observations[0].copy(), "opponent": batch.opponent_observations[0].copy()}

    def _infos(self) -> _Infos:
        return {side: mask_info(self.duel.choices[side]) for side in SIDES}

    def state(self) -> np.ndarray:
        """Return the full state, ``(54,)`` float32."""
        return np.asarray(self.duel.state()[0])

    def render(self) -> np.ndarray | None:
        """Return the picture of the present step, ``(height, width, 3)`` uint8, in mode ``rgb_array``."""
        return self._screen.picture()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._screen.close()


def mask_info(choices: Choices | None) -> Info:
    """Return the mask of an action mode as `sample` of its space takes it; nothing where there is none."""
    if choices is None:
        return {}
    masks = tuple(each.allowed.astype(np.int8) for each in choices.lists)
    return {"action_mask": masks if choices.is_multi else masks[0]}


def parallel_env(render_mode: str | None = None, *, game: str = DUEL, **options: Any) -> SeededParallelEnv:
    """Make the game in which all agents move at once: the duel, see :class:`FPGParallelEnv`, or another."""
    make = FPGParallelEnv if plain_id(game) == DUEL else game_product(game).make_env
    env: SeededParallelEnv = make(render_mode, **options)
    return env


def aec_env(render_mode: str | None = None, *, game: str = DUEL, **options: Any) -> AECEnv:
    """Make the same game with the agents taking turns within a step (PettingZoo's AEC interface)."""
    return OrderEnforcingWrapper(parallel_to_aec(parallel_env(render_mode, game=game, **options)))
