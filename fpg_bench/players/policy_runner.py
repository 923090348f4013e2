"""One side's seat in a batch of games: who plays where in this round, and with what memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.game import rng
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.full_state import full_state
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import player_seeds


class PolicyRunner:
    """Plays one side of an arena with one player, or with several drawn per round from the game's stream.

    Stochastic policies play their mode. Of several players, one with ``predict_rows`` is asked about the
    games where it plays in this round. Any other is asked about every game, so that its memory stays in
    step, and is heard where it plays.

    Args:
        side: ``ally`` or ``opponent``.
        players: at least one.
        arena: the games.
    """

    def __init__(self, side: str, players: Sequence[Player], batch: GameBatch) -> None:
        self.side = side
        self.players = tuple(players)
        self._batch = batch
        self._observations = batch.ally_observations if side == "ally" else batch.opponent_observations
        self._memories: list[Any] = [None] * len(self.players)
        self._starts = np.ones(batch.count, bool)
        self._stale_starts = True
        self.choice = np.zeros(batch.count, np.int64)
        self._asked_as = np.array([_first(self.players, index) for index in range(len(self.players))])
        self._rows: list[tuple[int, np.ndarray]] = []

    def begin(self, mask: np.ndarray) -> None:
        """Seat players for the rounds that the arena has just begun in the masked games."""
        keys = np.ascontiguousarray(self._batch.games["round_key"])
        if len(self.players) > 1:
            drawn = np.empty_like(self.choice)
            rng.derived_integers(drawn, keys, rng.PLAYER_CHOICE, len(self.players))
            self.choice[mask] = drawn[mask]
            self._rows = self._by_player()
        for index, player in enumerate(self.players):
            if getattr(player, "flies", None) == "pursuit":
                self._batch.pursue(mask & (self.choice == index))
        self._starts |= mask
        self._stale_starts = True
        seeds = player_seeds(keys, self.side)
        for player in self.players:
            if hasattr(player, "reset"):
                player.reset(mask, seeds)

    def act(self) -> np.ndarray:
        """The side's actions ``(N, 9)`` on the present observations.

        Raises:
            UserError: a player fails, or answers with another shape.
        """
        if len(self.players) == 1:
            actions = self._ask(0, None)
        else:
            actions = np.empty((self._batch.count, ACTION_SIZE), np.float32)
            for index, rows in self._rows:
                found = self._ask(index, rows)
                actions[rows] = found if len(found) == len(rows) else found[rows]
        if self._stale_starts:
            self._starts = np.zeros(self._batch.count, bool)
            self._stale_starts = False
        return actions

    def _by_player(self) -> list[tuple[int, np.ndarray]]:
        """Whom to ask, and the games where each plays; none where one only keeps its memory in step."""
        asked = self._asked_as[self.choice]
        order = np.argsort(asked, kind="stable")
        cuts = np.searchsorted(asked[order], np.arange(1, len(self.players)))
        return [
            (index, rows)
            for index, rows in enumerate(np.split(order, cuts))
            if len(rows) or not hasattr(self.players[index], "predict_rows")
        ]

    def _ask(self, index: int, rows: np.ndarray | None) -> np.ndarray:
        """A player's answer: in these games where it can be asked about some only, else in all."""
        player = self.players[index]
        seen = full_state(self._batch) if getattr(player, "sees", "") == "state" else self._observations
        told = (seen, self._memories[index], self._starts, True)
        count = self._batch.count
        try:
            if rows is not None and hasattr(player, "predict_rows"):
                count = len(rows)
                actions, self._memories[index] = player.predict_rows(rows, *told)
            else:
                actions, self._memories[index] = player.predict(*told)
        except UserError:
            raise
        except Exception as error:  # a player is anybody's code
            name, kind = type(player).__name__, type(error).__name__
            raise UserError(f"{self.side} {name}: its predict failed: {kind}: {error}") from error
        shape = getattr(actions, "shape", type(actions).__name__)
        if shape != (count, ACTION_SIZE):
            raise UserError(
                f"{self.side} {type(player).__name__}: answered with actions of shape {shape}, "
                f"expected {(count, ACTION_SIZE)}"
            )
        return actions


def _first(players: Sequence[Player], index: int) -> int:
    """Where a player that may stand in the list several times is asked: once, about all its games."""
    if not hasattr(players[index], "predict_rows"):
        return index
    return next(other for other, player in enumerate(players) if player is players[index])
