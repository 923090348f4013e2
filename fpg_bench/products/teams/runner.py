"""Runs the players of one side's seats in a batch of teams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side
from fpg_bench.game.batch import read_only
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.players.player import Abilities, Player
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.rules import MATES, MOST, TEAM_OBSERVATION_SIZE, told


class SeatRows:
    """The seats of one side as games of their own, row by row: what runners and cores read of a batch.

    Args:
        side: ``ally`` or ``opponent``.
        batch: the games.
    """

    def __init__(self, side: str, batch: TeamBatch) -> None:
        self.side, self.batch, self.scenario = side, batch, batch.scenario
        self.shape = (batch.count, batch.team.most[side == "opponent"])
        self.count = self.shape[0] * self.shape[1]

    @property
    def games(self) -> np.ndarray:
        """``(G K,)`` records of dtype ``state.GAME``."""
        return (self.batch.allies if self.side == "ally" else self.batch.opponents).reshape(-1)

    @property
    def ally_observations(self) -> np.ndarray:
        """``(G K, 67)`` float32, of whichever side this is."""
        return read_only(self._ally_observations)

    @property
    def _ally_observations(self) -> np.ndarray:
        seen = self.batch._observations[self.side == "opponent"]
        return seen.reshape(self.count, TEAM_OBSERVATION_SIZE)

    opponent_observations, _opponent_observations = ally_observations, _ally_observations

    def received(self, side: str) -> np.ndarray:
        """Return the seats' actions of the last step, ``(G K, 9)`` float32; a buffer."""
        return self.batch.received(side).reshape(self.count, -1)

    def pursue(self, mask: np.ndarray) -> None:
        """Make jammers of these rows pursue their allies."""
        self.batch.pursue(mask.reshape(self.shape))


class TeamRunner(PolicyRunner):
    """Plays all seats of one side: with one player, with one per seat, or with one that a game draws.

    Row ``g K + k`` of what players get is seat k of game g. Each seat has draws and a memory of its own, so a
    player that acts at random does not act alike in two seats. A player of the duel sees the first 15 numbers
    of its seat; one with ``sees = "team"`` sees all 67, and a trained one no more of its mates than in its
    training. A player with a method ``join(batch)`` is handed the
    :class:`fpg_bench.products.teams.batch.TeamBatch` first, as bounds need it, and one with
    ``foresee(actions)`` the rivals' actions of each step.

    Args:
        side: ``ally`` or ``opponent``.
        players: at least one; of several, each game draws one per round for all its seats.
        batch: the games.
        is_by_seat: seat k is played by player k instead, all rounds.

    Raises:
        UserError: an oracle of the duel, not as many players as seats, or an agent of other sizes of teams
            or of mates that tell more.
    """

    def __init__(
        self, side: str, players: Sequence[Player], batch: TeamBatch, is_by_seat: bool = False
    ) -> None:
        self._rows = SeatRows(side, batch)
        games, seats = self._rows.shape
        if is_by_seat and len(players) != seats:
            raise UserError(f"{side}: expected {seats} players, one per seat, got {len(players)}")
        for player in players:
            if Abilities.of(player).sees_state:
                raise UserError(f"{side}: {type(player).__name__} sees the state of a duel, which teams lack")
            if join := getattr(player, "join", None):
                join(batch)
        self._told = [self._seen_by(player) for player in players]
        super().__init__(side, players, self._rows)  # type: ignore[arg-type]
        self._seat_of_row = np.tile(np.arange(seats), games) if is_by_seat else None

    def begin(self, mask: np.ndarray) -> None:
        """Draw and reset players for the rounds that the batch has just begun.

        Args:
            mask: ``(G,)`` bool, the games whose rounds have begun.
        """
        super().begin(np.repeat(mask, self._rows.shape[1]))

    def act(self, known: Mapping[str, np.ndarray] = MappingProxyType({})) -> np.ndarray:
        """Return the actions of all seats, ``(G, K, 9)``; see :meth:`PolicyRunner.act`.

        Args:
            known: actions of this step by side, ``(G, K, 9)``, for players with a method ``foresee``.
        """
        for player in self.players:
            if foresee := getattr(player, "foresee", None):
                foresee(known[other_side(self.side)].copy())
        return super().act().reshape(*self._rows.shape, -1)

    def _drawn(self, keys: np.ndarray) -> np.ndarray:
        """Return the index of each row's player: its seat's, or one drawn by its game."""
        if self._seat_of_row is not None:
            return self._seat_of_row
        first = np.ascontiguousarray(self._rows.batch.games["round_key"])
        return np.repeat(super()._drawn(first), self._rows.shape[1])

    def _seen_by(self, player: Player) -> np.ndarray | None:
        """Return ``(67,)`` bool, the numbers that a player sees; None for one of the duel."""
        side, batch = self._rows.side, self._rows.batch
        if getattr(player, "sees", "") != "team":
            return None
        if not (skills := getattr(player, "skills", None)):
            return told(side, "full")
        for name, ends in zip(MOST, batch.team.counts, strict=True):
            low, high = skills["seats"][name]
            if not low <= ends[0] <= ends[1] <= high:
                here, known = (" to ".join(map(str, sorted({*of}))) for of in (ends, (low, high)))
                raise UserError(f"{side} {player}: was trained with {known} {name}, here are {here}")
        if MATES.index(skills["mates"]) > MATES.index(batch.mates[side]):
            raise UserError(
                f"{side} {player}: was trained with mates={skills['mates']!r}, here they tell "
                f"{batch.mates[side]!r}"
            )
        return told(side, skills["mates"])

    def _seen(self, index: int) -> np.ndarray:
        seen, numbers = self._rows._ally_observations, self._told[index]
        if numbers is None:
            seen = seen[:, :OBSERVATION_SIZE]
        elif not numbers.all():
            return seen * numbers.astype(np.float32)
        return seen if self._abilities[index].is_known else seen.copy()
