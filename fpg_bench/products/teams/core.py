"""Games of two teams: both in the caller's hands, or one of them against rivals."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from fpg_bench.common.ids import other_side
from fpg_bench.envs.core import action_space
from fpg_bench.game.batch import ActionError, Seeds, described
from fpg_bench.game.choices import action_choices
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.agent import expand_suites
from fpg_bench.players.scripted import player_noise, player_seeds
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.rules import SIDES, TEAM_ID, TEAM_OBSERVATION_SIZE
from fpg_bench.products.teams.runner import TeamRunner
from fpg_bench.products.teams.scripts import as_team_player
from fpg_bench.products.teams.spec import TeamSpec


class TeamStep(NamedTuple):
    """Results of a step, all copies; N allies and M jammers, absent seats are zeros.

    Observations ``(G, N, 67)`` and ``(G, M, 67)`` float32, rewards ``(G, N)`` and ``(G, M)`` float64, and
    ``(G,)`` bool.
    """

    ally_observations: np.ndarray
    opponent_observations: np.ndarray
    ally_rewards: np.ndarray
    opponent_rewards: np.ndarray
    truncated: np.ndarray


class TeamGame:
    """G games of two teams; a round that is over waits for :meth:`reset`.

    Args:
        game_spec: the game.
        games: number of games, G.

    Attributes:
        game_spec: the game.
        scenario: the scenario that is played.
        batch: the games and all their buffers.
        seats: the most allies and jammers, by side.
        choices: the choices of each side; None where its actions are continuous.
        observation_space: of one seat of either side.
        action_spaces: of one seat of each side.

    Raises:
        UserError: a scenario that teams cannot play, an unknown rival, or options out of range.
    """

    def __init__(self, game_spec: TeamSpec, games: int = 1) -> None:
        game_spec.check_trusted()
        self.game_spec, self.scenario = game_spec, game_spec.resolve()
        mates = {side: game_spec.of_side("mates", side) for side in SIDES}
        self.batch = TeamBatch(self.scenario, game_spec.team, games, mates)
        self.count = self.batch.count
        self.seats = dict(zip(SIDES, game_spec.team.most, strict=True))
        self.choices = {
            side: action_choices(side, game_spec.of_side("actions", side), self.scenario) for side in SIDES
        }
        self.observation_space = spaces.Box(-1.0, 1.0, (TEAM_OBSERVATION_SIZE,), np.float32)
        self.action_spaces = {side: action_space(self.choices[side]) for side in SIDES}
        self._runner: TeamRunner | None = None
        if game_spec.side is not None:
            theirs, team = other_side(game_spec.side), game_spec.team
            others = expand_suites(game_spec.others, theirs)
            players = [as_team_player(other, theirs, self.scenario, team) for other in others]
            self._runner = TeamRunner(theirs, players, self.batch, game_spec.is_by_seat)

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> np.ndarray:
        """Begin rounds in the masked games; see :meth:`fpg_bench.game.batch.GameBatch.reset`.

        Returns:
            The mask, as an array.
        """
        mask = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
        self.batch.reset(mask, seeds, horizons, new_match)
        if self._runner is not None:
            self._runner.begin(mask)
        return mask

    def step(
        self, ally_actions: np.ndarray | None = None, opponent_actions: np.ndarray | None = None
    ) -> TeamStep:
        """Play one step.

        Args:
            ally_actions, opponent_actions: ``(G, N, 9)`` and ``(G, M, 9)`` floats, or choices ``(G, N)``,
                in mode ``multi-discrete`` ``(G, N, lists)``. None of the side that rivals play.

        Raises:
            ActionError: see ``TeamBatch.step`` and ``Choices.decode``; also actions of the rivals' side.
        """
        given = dict(zip(SIDES, (ally_actions, opponent_actions), strict=True))
        self.play({side: self.decode(side, each) for side, each in given.items() if each is not None})
        return self.present()

    def play(self, actions: dict[str, np.ndarray]) -> None:
        """Play one step with ``(G, K, 9)`` floats of the sides that the caller plays."""
        if self._runner is not None:
            if self._runner.side in actions:
                raise ActionError(f"{self._runner.side} actions: rivals play this side; leave them out")
            actions = actions | {self._runner.side: self._runner.act(actions)}
        self.batch.step(*(actions.get(side, np.zeros(0)) for side in SIDES))

    def decode(self, side: str, actions: np.ndarray) -> np.ndarray:
        """Return a side's actions as ``(G, K, 9)`` floats, from its choices if it has a list of them."""
        choices, shape = self.choices[side], (self.count, self.seats[side])
        if choices is None:
            return actions
        columns = (len(choices.lists),) if choices.is_multi else ()
        if not isinstance(actions, np.ndarray) or actions.shape != (*shape, *columns):
            expected = f"expected whole numbers of shape {(*shape, *columns)}"
            raise ActionError(f"{side} actions: {expected}, got {described(actions)}")
        seen = self.observations(side).reshape(-1, TEAM_OBSERVATION_SIZE)
        noise = self.noise(side) if choices.is_drawn else None
        rows = choices.decode(actions.reshape(-1, *columns), seen, f"{side} seats", noise)
        return rows.reshape(*shape, ACTION_SIZE)

    def noise(self, side: str) -> np.ndarray:
        """Return ``(G K, 1)`` float32, the noise of a side's players at this step, seat by seat."""
        records = self.records(side).reshape(-1)
        return player_noise(player_seeds(records["round_key"], side), records["step"])

    def records(self, side: str) -> np.ndarray:
        """Return the records of a side's seats, ``(G, K)``; a buffer."""
        return self.batch.allies if side == "ally" else self.batch.opponents

    def observations(self, side: str) -> np.ndarray:
        """Return the observations of a side's seats, ``(G, K, 67)``; a buffer."""
        return self.batch.ally_observations if side == "ally" else self.batch.opponent_observations

    def rewards(self, side: str) -> np.ndarray:
        """Return the rewards of a side's seats for the last step, ``(G, K)`` float64."""
        return self.batch.rewards(side, self.game_spec.of_side("reward", side))

    def present(self) -> TeamStep:
        """Return the present observations, the last step's rewards and which rounds are over, as copies."""
        return TeamStep(
            self.batch.ally_observations.copy(),
            self.batch.opponent_observations.copy(),
            self.rewards("ally"),
            self.rewards("opponent"),
            self.batch.games["truncated"].copy(),
        )

    def measures(self, game: int, seat: int | None = None) -> dict[str, float | None]:
        """Return the measures of one game's present round so far, of one ally or of all of them.

        Returns are means over these allies; ``opponent_return`` is that of the reward ``team``.
        """
        return self.batch.measures(game, seat)

    def state(self) -> np.ndarray:
        """Return the full state, ``(G, 607)``; see :meth:`fpg_bench.products.teams.batch.TeamBatch.state`."""
        return self.batch.state()


def make_team(games: int = 1, *, game: str | TeamSpec = TEAM_ID, **options: Any) -> TeamGame:
    """Make a batch of games of two teams.

    >>> team = make_team(64, allies=3, jammers=2)
    >>> team.reset(seeds=0).sum()
    np.int64(64)
    >>> step = team.step(np.zeros((64, 3, 9)), np.zeros((64, 2, 9)))
    >>> step.ally_observations.shape, step.opponent_rewards.shape
    ((64, 3, 67), (64, 2))

    Args:
        games: number of games, G.
        game: ``FPG/team_v0``, or a specification whose options are replaced.
        **options: the attributes of :class:`TeamSpec` and of
            :class:`fpg_bench.products.teams.rules.TeamRules`: ``scenario``, ``path``, ``actions``, ``mates``,
            ``reward``, ``side``, ``against``, ``allies``, ``jammers``, ``formation``, ``spacing_m``,
            ``code_orthogonality`` and ``share_power``.

    Raises:
        UserError: an unknown option, a value out of range, or options that exclude each other.
    """
    return TeamGame(TeamSpec.of(game, **options), games)
