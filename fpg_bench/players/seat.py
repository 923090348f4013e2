"""One side's seat in a batch of games: who plays where in this round, and with what memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.game import draws
from fpg_bench.game.arena import Arena
from fpg_bench.game.full_state import full_state
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import player_seeds


class Seat:
    """Plays one side of an arena with one player, or with several drawn per round from the game's stream.

    Every player is asked about every game, so that its memory stays in step, and is heard where it plays.

    Args:
        side: ``ally`` or ``opponent``.
        players: at least one.
        arena: the games.
        deterministic: whether stochastic policies play their mode.
    """

    def __init__(
        self, side: str, players: Sequence[Player], arena: Arena, deterministic: bool = True
    ) -> None:
        self.side = side
        self.players = tuple(players)
        self._arena = arena
        self._deterministic = deterministic
        self._observations = arena.ally_observations if side == "ally" else arena.opponent_observations
        self._memories: list[Any] = [None] * len(self.players)
        self._starts = np.ones(arena.count, bool)
        self._stale_starts = True
        self.choice = np.zeros(arena.count, np.int64)

    def begin(self, mask: np.ndarray) -> None:
        """Seat players for the rounds that the arena has just begun in the masked games."""
        keys = np.ascontiguousarray(self._arena.games["round_key"])
        if len(self.players) > 1:
            drawn = np.empty_like(self.choice)
            draws.derived_integers(drawn, keys, draws.PLAYER_CHOICE, len(self.players))
            self.choice[mask] = drawn[mask]
        for index, player in enumerate(self.players):
            if getattr(player, "flies", None) == "pursuit":
                self._arena.pursue(mask & (self.choice == index))
        self._starts |= mask
        self._stale_starts = True
        for player in self.players:
            if hasattr(player, "reset"):
                player.reset(mask, player_seeds(keys, self.side))

    def act(self) -> np.ndarray:
        """The side's actions ``(N, 9)`` on the present observations.

        Raises:
            UserError: a player fails, or answers with another shape.
        """
        actions = self._ask(0)
        for index in range(1, len(self.players)):
            actions = np.where((self.choice == index)[:, None], self._ask(index), actions)
        if self._stale_starts:
            self._starts = np.zeros(self._arena.count, bool)
            self._stale_starts = False
        return actions

    def _ask(self, index: int) -> np.ndarray:
        player = self.players[index]
        seen = full_state(self._arena) if getattr(player, "sees", "") == "state" else self._observations
        memory = self._memories[index]
        try:
            actions, self._memories[index] = player.predict(seen, memory, self._starts, self._deterministic)
        except UserError:
            raise
        except Exception as error:  # a player is anybody's code
            name, kind = type(player).__name__, type(error).__name__
            raise UserError(f"{self.side} {name}: its predict failed: {kind}: {error}") from error
        shape = getattr(actions, "shape", type(actions).__name__)
        if shape != (self._arena.count, ACTION_SIZE):
            raise UserError(
                f"{self.side} {type(player).__name__}: answered with actions of shape {shape}, "
                f"expected {(self._arena.count, ACTION_SIZE)}"
            )
        return actions
