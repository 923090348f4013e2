"""One player at several tables: it is asked about all their games at once, as one batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.matches.rounds import Table
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import player_seeds


def together(player: Player, side: str, tables: Sequence[Table]) -> list[Table]:
    """Tables of which one side is played by one player, which is asked once a step about all of them.

    They must be played together, see :func:`fpg_bench.matches.rounds.play_round`.

    Args:
        player: plays each game for itself, whatever its batch.
        side: which it plays, ``ally`` or ``opponent``.
        tables: with somebody at the other side; their games stand in the player's batch in this order.
    """
    whole = _Together(player, side, tables)
    seats: list[dict[str, Any]] = [{side: _Part(whole, index)} for index in range(len(tables))]
    return [dataclasses.replace(table, **seat) for table, seat in zip(tables, seats, strict=True)]


class _Together:
    """A player that is asked about the games of several tables at once."""

    def __init__(self, player: Player, side: str, tables: Sequence[Table]) -> None:
        self._player, self._side = player, side
        self._games = [table.duel.arena.games for table in tables]
        self._views = [getattr(table.duel.arena, f"{side}_observations") for table in tables]
        self._cuts = np.cumsum([table.duel.count for table in tables])[:-1]
        self._memory: Any = None
        self._starts = np.zeros(sum(table.duel.count for table in tables), bool)
        self._answers: list[np.ndarray] = []

    def begin(self, index: int, mask: np.ndarray) -> None:
        np.split(self._starts, self._cuts)[index][mask] = True

    def actions(self, index: int) -> np.ndarray:
        """The actions at one table; the first asks for all."""
        if index == 0:
            if self._starts.any() and hasattr(self._player, "reset"):
                keys = np.concatenate([games["round_key"] for games in self._games])
                self._player.reset(self._starts.copy(), player_seeds(keys, self._side))
            seen = np.concatenate(self._views)
            actions, self._memory = self._player.predict(seen, self._memory, self._starts.copy(), True)
            self._starts[:] = False
            self._answers = np.split(actions, self._cuts)
        return self._answers[index]


@dataclasses.dataclass(frozen=True)
class _Part:
    """The seat of such a player at one table."""

    whole: _Together
    index: int

    def begin(self, mask: np.ndarray) -> None:
        self.whole.begin(self.index, mask)

    def act(self) -> np.ndarray:
        return self.whole.actions(self.index)
