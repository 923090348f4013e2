"""Stable-Baselines3 environments of one team: a native ``VecEnv`` whose slots are the seats of G games."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.common.extras import require_extra

require_extra("train", "stable_baselines3")

from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import Core
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.envs.team import TEAM, TeamGame, TeamSpec, make_team
from fpg_bench.game.batch import ActionError, Seeds, described


class TeamRows(Core):
    """G games of which the caller plays one side's K seats, row by row: seat k of game g is row g K + k.

    Args:
        game_spec: a game with ``side`` and ``rivals``.
        games: number of games, G.

    Attributes:
        game_spec: the game.
        duel: the games of both teams.
        side: the side that the caller plays.
        choices: what a seat chooses from; None where actions are continuous.
        waterfall: None, as seats see numbers.
        observation_space, action_space: of one seat.
        count: number of rows, G K.

    Raises:
        UserError: no rivals, or a number of seats that is drawn by the round.
    """

    waterfall = None

    def __init__(self, game_spec: TeamSpec, games: int = 1) -> None:
        if game_spec.side is None:
            raise UserError("rivals: a VecEnv has the seats of one side; give side='ally' and rivals=...")
        self.game_spec, self.side = game_spec, game_spec.side  # type: ignore[assignment]
        low, high = game_spec.team.counts[self.side == "opponent"]
        if low != high:
            raise UserError(
                f"{'allies' if self.side == 'ally' else 'jammers'}: a VecEnv has as many rows in all rounds; "
                f"give one number, not {low} to {high}"
            )
        self.duel: TeamGame = make_team(games, game=game_spec)  # type: ignore[assignment]
        self.scenario, self.seats = self.duel.scenario, high
        self.count = self.duel.count * high
        self.choices = self.duel.choices[self.side]
        self.observation_space = self.duel.observation_space
        self.action_space = self.duel.action_spaces[self.side]

    @property
    def observations(self) -> np.ndarray:
        """``(G K, 67)`` float32; a buffer."""
        return self.duel.observations(self.side).reshape(self.count, -1)

    @property
    def rewards(self) -> np.ndarray:
        """``(G K,)`` float64: of the last step."""
        return self.duel.rewards(self.side).reshape(-1)

    @property
    def truncated(self) -> np.ndarray:
        """``(G K,)`` bool."""
        return np.repeat(self.duel.batch.games["truncated"], self.seats)

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Begin rounds; mask and horizons are by row, and seeds by game: those of the first G rows."""
        if isinstance(seeds, np.ndarray):
            seeds = seeds[: self.duel.count]
        first = slice(None, None, self.seats)
        mask, horizons = (None if each is None else each[first] for each in (mask, horizons))
        self.duel.reset(mask, seeds, new_match, horizons)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with the actions of all rows, ``(G K, 9)`` floats or choices."""
        if not isinstance(actions, np.ndarray) or actions.shape[:1] != (self.count,):
            raise ActionError(f"actions: expected an array of {self.count} rows, got {described(actions)}")
        self.duel.step(**{f"{self.side}_actions": actions.reshape(-1, self.seats, *actions.shape[1:])})

    def measures(self, game: int) -> dict[str, float | None]:
        """Return the measures of a row's present round: an ally's own; of a jammer's row, all allies'."""
        number, seat = divmod(game, self.seats)
        return self.duel.measures(number, seat if self.side == "ally" else None)

    def length(self, game: int) -> int:
        """Return the steps that a row's present round has had."""
        return int(self.duel.batch.games["step"][game // self.seats])

    def action_masks(self, game: int = 0) -> np.ndarray:
        """Return the choices that the scenario allows, ``(n,)`` bool, as sb3-contrib's MaskablePPO asks."""
        if self.choices is None:
            raise UserError("action_masks: actions are continuous here; use actions='discrete'")
        return self.choices.mask


def make_sb3_team(
    n_envs: int = 1,
    seed: int | None = None,
    stagger: bool = False,
    *,
    game: str | TeamSpec = TEAM,
    **options: Any,
) -> FPGVecEnv:
    """Make a native SB3 ``VecEnv`` of the seats of one side: one policy learns them all.

    Observations are ``(G K, 67)`` float32, actions ``(G K, 9)`` floats in [-1, 1] or choices, rewards
    ``(G K,)`` float32; row g K + k is seat k of game g.

    >>> env = make_sb3_team(16, seed=0, side="ally", rivals="watchful", actions="discrete")
    >>> env.reset().shape
    (48, 67)

    Args:
        n_envs: number of games, G.
        seed: game g begins with a match of seed + g; None: random.
        stagger: cut the first rounds after seeding at evenly spread steps, so that a batch mixes phases.
        game: ``FPG/team_v0``, or a specification whose options are replaced.
        **options: those of :func:`fpg_bench.envs.team.make_team`, with ``side`` and ``rivals``.

    Raises:
        UserError: something unknown, out of range, or impossible together.
    """
    core = TeamRows(TeamSpec.of(game, **options), n_envs)
    return FPGVecEnv(core, seed, stagger)  # type: ignore[arg-type]
