"""Runs the policy of one side in a batch of games, with its memory and its draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.imports import reason
from fpg_bench.game import rng
from fpg_bench.game.batch import GameBatch, read_only
from fpg_bench.game.full_state import full_state
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import Abilities, Memory, Player
from fpg_bench.players.scripted import player_seeds
from fpg_bench.players.stack import PolicyStack, stacks


class PolicyRunner:
    """Plays one side of a game batch with one player, or with several drawn per round.

    Players are drawn from the stream of each game. Stochastic policies play their mode. If there are several
    players, one with ``predict_rows`` is called for the games that it plays in this round. Any other is
    called for every game, so that its memory stays in step; its actions count where it plays.

    Args:
        side: ``ally`` or ``opponent``.
        players: at least one.
        batch: the games.
        purpose: of the draws of players, in :mod:`fpg_bench.game.rng`; sides that draw for the same purpose
            draw the same numbers.
        stacked: compute agents of equal layer sizes together, equal to onnxruntime to 1e-5
            (:mod:`fpg_bench.players.stack`); for training, never for results.

    Attributes:
        observations: ``(N, 15)`` float32 of the side, the game's own buffer, which nobody may write into.
        choice: ``(N,)`` int64, the index of the player that plays in each game.
    """

    def __init__(
        self,
        side: str,
        players: Sequence[Player],
        batch: GameBatch,
        purpose: int = rng.PLAYER_CHOICE,
        stacked: bool = False,
    ) -> None:
        self.side = side
        self.players = tuple(players)
        self.choice = np.zeros(batch.count, np.int64)
        self._batch = batch
        self._purpose = purpose
        own = batch._ally_observations if side == "ally" else batch._opponent_observations
        self.observations = own
        self._abilities = [Abilities.of(player) for player in self.players]
        self._callers = np.array([self._caller(index) for index in range(len(self.players))])
        self._memories: list[Memory] = [None] * len(self.players)
        self._starts = read_only(np.ones(batch.count, bool))
        self._has_starts = True
        self._calls: list[tuple[int, np.ndarray]] = []
        self._stacks = stacks(self.players, side, batch) if stacked else []
        self._inside = {index for _, indices in self._stacks for index in indices}
        self._pursues = np.array([abilities.pursues for abilities in self._abilities])
        outside = (each for index, each in enumerate(self._abilities) if index not in self._inside)
        self._resets = [each.reset for each in outside if each.reset is not None]
        self._stack_calls: list[tuple[PolicyStack, np.ndarray, np.ndarray]] = []

    def begin(self, mask: np.ndarray) -> None:
        """Draw and reset players for the rounds that the batch has just begun.

        Args:
            mask: ``(N,)`` bool, the games whose rounds have begun.
        """
        keys = np.ascontiguousarray(self._batch.games["round_key"])
        if len(self.players) > 1:
            self.choice[mask] = self._drawn(keys)[mask]
            self._calls = self._rows_by_player()
            self._stack_calls = self._rows_by_stack()
        if self._pursues.any():
            self._batch.pursue(mask & self._pursues[self.choice])
        self._starts = read_only(self._starts | mask)
        self._has_starts = True
        seeds = player_seeds(keys, self.side)
        for reset in self._resets:
            reset(mask.copy(), seeds.copy())

    def _drawn(self, keys: np.ndarray) -> np.ndarray:
        """Return ``(N,)`` int64, the index of the player that each game draws for its round."""
        drawn = np.empty(len(keys), np.int64)
        rng.derived_integers(drawn, keys, self._purpose, len(self.players))
        return drawn

    def _seen(self, index: int) -> np.ndarray:
        """Return what a player sees of all games; the game's own buffer only to those that do not write."""
        abilities = self._abilities[index]
        if abilities.sees_state:
            return full_state(self._batch)
        return self.observations if abilities.is_known else self.observations.copy()

    def act(self) -> np.ndarray:
        """Return the side's actions ``(N, 9)`` for the current observations.

        Raises:
            UserError: a player fails, or returns actions of another shape.
        """
        if len(self.players) == 1:
            actions = self._predict(0, None)
        else:
            actions = np.empty((self._batch.count, ACTION_SIZE), np.float32)
            for index, rows in self._calls:
                answer = self._predict(index, rows)
                actions[rows] = answer if len(answer) == len(rows) else answer[rows]
            for stack, rows, members in self._stack_calls:
                actions[rows] = stack.actions(self.observations, self._starts, rows, members)
        if self._has_starts:
            self._starts = read_only(np.zeros(self._batch.count, bool))
            self._has_starts = False
        return actions

    def _caller(self, index: int) -> int:
        """Return the first index of a player that is listed several times: it is called once for all."""
        if self._abilities[index].predict_rows is None:
            return index
        return next(k for k, player in enumerate(self.players) if player is self.players[index])

    def _rows_by_player(self) -> list[tuple[int, np.ndarray]]:
        """Return the players to call outside stacks, each with the games that it plays."""
        callers = self._callers[self.choice]
        order = np.argsort(callers, kind="stable")
        cuts = np.searchsorted(callers[order], np.arange(1, len(self.players)))
        return [
            (index, rows)
            for index, rows in enumerate(np.split(read_only(order), cuts))
            if index not in self._inside and (len(rows) or self._abilities[index].predict_rows is None)
        ]

    def _rows_by_stack(self) -> list[tuple[PolicyStack, np.ndarray, np.ndarray]]:
        """Return the stacks to call, each with the games that it plays and its member in each."""
        callers, calls = self._callers[self.choice], []
        for stack, indices in self._stacks:
            rows = np.flatnonzero(np.isin(callers, indices))
            if len(rows):
                calls.append((stack, rows, np.searchsorted(indices, callers[rows])))
        return calls

    def _predict(self, index: int, rows: np.ndarray | None) -> np.ndarray:
        """Call a player for the games ``rows`` if it has ``predict_rows``, otherwise for all games."""
        player, abilities = self.players[index], self._abilities[index]
        arguments = (self._seen(index), self._memories[index], self._starts, True)
        count = self._batch.count
        try:
            if rows is not None and abilities.predict_rows is not None:
                count = len(rows)
                actions, self._memories[index] = abilities.predict_rows(rows, *arguments)
            else:
                actions, self._memories[index] = player.predict(*arguments)
        except UserError:
            raise
        except Exception as error:  # a player may be anybody's code
            name = type(player).__name__
            raise UserError(f"{self.side} {name}: its predict failed: {reason(error)}") from error
        shape = getattr(actions, "shape", type(actions).__name__)
        if shape != (count, ACTION_SIZE):
            raise UserError(
                f"{self.side} {type(player).__name__}: answered with actions of shape {shape}, "
                f"expected {(count, ACTION_SIZE)}"
            )
        return actions
