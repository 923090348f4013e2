"""PettingZoo environments of teams: all seats moving at once or in turns, of both sides or of one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from gymnasium import spaces

from fpg_bench.common.checks import mapping
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.envs.core import Info, ResetOptions, as_info, one_action
from fpg_bench.envs.pettingzoo_env import SeededParallelEnv, mask_info
from fpg_bench.game.batch import ActionError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.products.teams.batch import TEAM_STATE_SIZE
from fpg_bench.products.teams.core import make_team
from fpg_bench.products.teams.rules import SIDES
from fpg_bench.products.teams.spec import TeamSpec

_Observations = dict[str, np.ndarray]  # by agent, as the infos
_Infos = dict[str, Info]


class TeamParallelEnv(SeededParallelEnv):
    """One game of two teams, with the agents ``ally_0``, ``ally_1``, ..., ``opponent_0``, ...

    Each agent has the observation space ``Box(-1, 1, (67,), float32)``, and the action space and choices of
    its side in the duel (:class:`fpg_bench.envs.pettingzoo_env.FPGParallelEnv`). If numbers are drawn by the
    round, ``agents`` are those that are present. ``state()`` is the full state ``(607,)`` float32.

    >>> env = TeamParallelEnv(side="ally", against="watchful")
    >>> observations, infos = env.reset(seed=0)
    >>> env.agents
    ['ally_0', 'ally_1', 'ally_2']

    Args:
        render_mode: None; teams are not drawn.
        **options: those of :func:`fpg_bench.products.teams.core.make_team`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "team_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            raise UserError(f"render_mode: teams are not drawn, got {render_mode!r}")
        self.team = make_team(1, **options)
        self.render_mode = None
        sides = SIDES if self.game_spec.side is None else (self.game_spec.side,)
        self._places = {f"{side}_{k}": (side, k) for side in sides for k in range(self.team.seats[side])}
        super().__init__(
            dict.fromkeys(self._places, self.team.observation_space),
            {agent: self.team.action_spaces[side] for agent, (side, _) in self._places.items()},
        )
        self.state_space = spaces.Box(-1.0, 1.0, (TEAM_STATE_SIZE,), np.float32)

    @property
    def game_spec(self) -> TeamSpec:
        """The game, as :func:`fpg_bench.products.teams.core.make_team` opens it again."""
        return self.team.game_spec

    def reset(
        self, seed: int | None = None, options: ResetOptions | None = None
    ) -> tuple[_Observations, _Infos]:
        """Begin a round."""
        self._begin(self.team.reset, seed, options)
        counts = dict(zip(SIDES, self.team.batch.counts[0].tolist(), strict=True))
        self.agents = [agent for agent, (side, k) in self._places.items() if k < counts[side]]
        return dict(self._observed()), self._infos()

    def step(
        self, actions: dict[str, np.ndarray]
    ) -> tuple[_Observations, dict[str, float], dict[str, bool], dict[str, bool], _Infos]:
        """Play one step with the actions of all agents, ``(9,)`` or a choice.

        Raises:
            ActionError: an agent's action is missing, of a wrong shape or dtype, holds NaN or infinity, or is
                a choice that is out of range or forbidden; or an action of no agent, or of an absent one.
        """
        if not self.agents:
            return self._after_the_end(actions)
        self.team.play(self._played(mapping(actions, "step: actions by agent")))
        over, playing = bool(self.team.batch.games["truncated"][0]), self.agents
        observations, infos = dict(self._observed()), self._infos()
        by_side = {side: self.team.rewards(side)[0].tolist() for side in SIDES}
        rewards = {agent: by_side[side][k] for agent, (side, k) in self._present()}
        for agent in playing if over else ():
            side, k = self._places[agent]
            infos[agent]["measures"] = as_info(self.team.measures(0, k if side == "ally" else None))
        if over:
            self.agents = []
        return observations, rewards, dict.fromkeys(playing, False), dict.fromkeys(playing, over), infos

    def _played(self, actions: Any) -> dict[str, np.ndarray]:
        """Return the actions ``(1, K, 9)`` of each side that the caller plays; absent seats rest."""
        for name in actions:
            if name not in self._places:
                raise ActionError(f"step: no agent {name!r}{nearest(str(name), self.possible_agents)}")
            if name not in self.agents:
                raise ActionError(f"step: {name} is absent in this round; it has {', '.join(self.agents)}")
        sides = dict.fromkeys(side for side, _ in self._places.values())
        played = {side: np.zeros((1, self.team.seats[side], ACTION_SIZE)) for side in sides}
        for agent, (side, k) in self._present():
            choices = self.team.choices[side]
            action = one_action(actions.get(agent), agent, choices)
            if choices is not None:
                noise = self.team.noise(side)[k : k + 1] if choices.is_drawn else None
                action = choices.decode(action, self.team.observations(side)[:, k], agent, noise)
            played[side][0, k] = action[0]
        return played

    def _present(self) -> Iterator[tuple[str, tuple[str, int]]]:
        return ((agent, self._places[agent]) for agent in self.agents)

    def _observed(self) -> Iterator[tuple[str, np.ndarray]]:
        return ((agent, self.team.observations(side)[0, k].copy()) for agent, (side, k) in self._present())

    def _infos(self) -> _Infos:
        return {agent: mask_info(self.team.choices[side]) for agent, (side, _) in self._present()}

    def state(self) -> np.ndarray:
        """Return the full state, ``(607,)`` float32."""
        return np.asarray(self.team.state()[0])

    def render(self) -> None:
        """Return None: teams are not drawn."""

    def close(self) -> None:
        """Do nothing: there is no window."""
