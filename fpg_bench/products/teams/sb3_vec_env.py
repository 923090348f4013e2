"""Stable-Baselines3 environments of one team: a native ``VecEnv`` whose slots are the seats of G games."""

from __future__ import annotations

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import Core
from fpg_bench.game.batch import ActionError, Seeds, described
from fpg_bench.products.teams.core import TeamGame
from fpg_bench.products.teams.runner import SeatRows
from fpg_bench.products.teams.spec import TeamSpec


class TeamRows(Core):
    """G games of which the caller plays one side's K seats, row by row: seat k of game g is row g K + k.

    Args:
        game_spec: a game of one side.
        games: number of games, G.

    Attributes:
        game_spec: the game.
        teams: the games of both teams.
        side: the side that the caller plays.
        choices: what a seat chooses from; None where actions are continuous.
        waterfall: None, as seats see numbers.
        observation_space, action_space: of one seat.
        count: number of rows, G K.

    Raises:
        UserError: the caller plays both sides, or a number of seats that is drawn by the round.
    """

    waterfall = None
    samples = TeamSpec.samples

    def __init__(self, game_spec: TeamSpec, games: int = 1) -> None:
        self.game_spec, self.side = game_spec, game_spec.config.side
        low, high = game_spec.counts[self.side == "opponent"]
        if low != high:
            raise UserError(
                f"{'allies' if self.side == 'ally' else 'jammers'}: a VecEnv has as many rows in all rounds; "
                f"give one number, not {low} to {high}"
            )
        self.teams = TeamGame(game_spec, games)
        self.scenario, self.seats = self.teams.scenario, high
        self.count = self.teams.count * high
        self.choices = self.teams.choices[self.side]
        self.observation_space = self.teams.observation_space
        self.action_space = self.teams.action_spaces[self.side]

    @property
    def batch(self) -> SeatRows:
        """The seats as games of their own, row by row."""
        return SeatRows(self.side, self.teams.batch)

    @property
    def observations(self) -> np.ndarray:
        """``(G K, 67)`` float32; a buffer."""
        return self.batch.ally_observations

    @property
    def rewards(self) -> np.ndarray:
        """``(G K,)`` float64: of the last step."""
        return self.teams.rewards(self.side).reshape(-1)

    @property
    def truncated(self) -> np.ndarray:
        """``(G K,)`` bool."""
        return np.repeat(self.teams.batch.games["truncated"], self.seats)

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Begin rounds; mask and horizons are by row, and seeds by game: those of the first G rows."""
        if isinstance(seeds, np.ndarray):
            seeds = seeds[: self.teams.count]
        first = slice(None, None, self.seats)
        mask, horizons = (None if each is None else each[first] for each in (mask, horizons))
        self.teams.reset(mask, seeds, new_match, horizons)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with the actions of all rows, ``(G K, 9)`` floats or choices."""
        if not isinstance(actions, np.ndarray) or actions.shape[:1] != (self.count,):
            raise ActionError(f"actions: expected an array of {self.count} rows, got {described(actions)}")
        rows = actions.reshape(-1, self.seats, *actions.shape[1:])
        self.teams.play({self.side: self.teams.decode(self.side, rows)})

    def measures(self, game: int) -> dict[str, float | None]:
        """Return the measures of a row's present round: an ally's own; of a jammer's row, all allies'."""
        number, seat = divmod(game, self.seats)
        return self.teams.measures(number, seat if self.side == "ally" else None)

    def action_masks(self, game: int = 0) -> np.ndarray:
        """Return the choices that the scenario allows, ``(n,)`` bool, as sb3-contrib's MaskablePPO asks."""
        if self.choices is None:
            raise UserError("action_masks: actions are continuous here; use actions='discrete'")
        return self.choices.mask
