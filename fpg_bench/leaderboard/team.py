"""Several policies as one player: each plays its own games of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import Player


class Team:
    """Plays each game of a batch with one of several players, whose states are kept apart.

    Args:
        players: the members.
        seats: ``(n,)`` which of them plays each game.
    """

    def __init__(self, players: Sequence[Player], seats: np.ndarray) -> None:
        self._members = [(player, np.flatnonzero(seats == k)) for k, player in enumerate(players)]
        self._members = [(player, games) for player, games in self._members if len(games)]

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Hand the masked games' seeds to the members that draw."""
        for player, games in self._members:
            if hasattr(player, "reset"):
                player.reset(mask[games], seeds[games])

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Play one step; see :class:`fpg_bench.players.player.Player`."""
        memories = [None] * len(self._members) if state is None else state
        actions, after = np.empty((len(observation), ACTION_SIZE), np.float32), []
        for (player, games), memory in zip(self._members, memories, strict=True):
            starts = None if episode_start is None else episode_start[games]
            actions[games], memory = player.predict(observation[games], memory, starts, deterministic)
            after.append(memory)
        return actions, after

    @property
    def invalid(self) -> np.ndarray:
        """``(n,)`` bool: the games whose present round a member has lost by an answer that is none."""
        found = np.zeros(sum(len(games) for _, games in self._members), bool)
        for player, games in self._members:
            found[games] = getattr(player, "invalid", False)
        return found
