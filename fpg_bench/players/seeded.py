"""Base classes of players: one call for many games, and draws from the stream of each game's round."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from fpg_bench.players.player import Memory, Prediction


def fresh_memory(kind: Any, count: int, state: Memory, starts: np.ndarray | None) -> np.ndarray:
    """Return a copy of a memory of one array, zero at first and where a round starts."""
    memory: np.ndarray = np.zeros(count, kind) if state is None else state.copy()
    if starts is not None:
        memory[starts] = 0
    return memory


class Batched:
    """Base class of players that take the observations of one game or of a batch."""

    def predict(
        self,
        observation: np.ndarray,
        state: Memory = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Play one step of one game or of many; see :class:`fpg_bench.players.player.Player`."""
        if observation.ndim == 1:
            actions, state = self.predict(observation[None], state, episode_start)
            return actions[0], state
        return self._answer(observation, state, episode_start)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        """Return the actions in a batch of games and the next memory."""
        raise NotImplementedError


class Seeded(Batched):
    """Base class of players that draw at random, with one key per game.

    A game that never got a key uses its own index.
    """

    _keys = np.empty(0, np.uint64)

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Take the seeds ``(n,)`` uint64 of the games in ``mask`` for the draws of this round."""
        if len(self._keys) != len(seeds):
            self._keys = np.zeros(len(seeds), np.uint64)
        self._keys[mask] = seeds[mask]

    def keys(self, count: int) -> np.ndarray:
        """Return the keys ``(count,)`` uint64 of the current rounds."""
        if len(self._keys) != count:
            self._keys = np.arange(count, dtype=np.uint64)
        return self._keys


class SeededPolicy(Seeded):
    """Base class of players that draw at random and can be called for some of their games only.

    A subclass treats every game by itself, and its memory is None, an array with a row per game, or a tuple
    of these.
    """

    @contextlib.contextmanager
    def playing(self, games: np.ndarray, count: int) -> Iterator[None]:
        """Within the context, play only these of ``count`` games, in this order, each with its own key."""
        all_keys = self.keys(count)
        self._keys = all_keys[games]
        try:
            yield
        finally:
            self._keys = all_keys

    def predict_rows(
        self,
        rows: np.ndarray,
        observation: np.ndarray,
        state: Memory = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Play one step of some games; the memory of the others stays as it is.

        Args:
            rows: ``(k,)`` indices of the games, without repetition.
            observation, state, episode_start, deterministic: of all n games, as for ``predict``. The state
                is changed in place.

        Returns:
            Actions ``(k, 9)``, identical to those of ``predict`` in these games, and the memory of all n.
        """
        count = len(observation)
        starts = None if episode_start is None else episode_start[rows]
        with self.playing(rows, count):
            actions, memory = self.predict(observation[rows], _take(state, rows), starts, deterministic)
        return actions, _put(state, rows, memory, count)


def _take(state: Memory, rows: np.ndarray) -> Memory:
    """Return the rows of a memory that belong to some games."""
    if isinstance(state, tuple):
        return tuple(_take(part, rows) for part in state)
    return None if state is None else state[rows]


def _put(state: Memory, rows: np.ndarray, new: Memory, count: int) -> Memory:
    """Return the memory of all games with the new rows of some; zeros for games that never played."""
    if isinstance(new, tuple):
        parts = [None] * len(new) if state is None else state
        return tuple(_put(part, rows, value, count) for part, value in zip(parts, new, strict=True))
    if new is None:
        return None
    if state is None:
        state = np.zeros((count, *new.shape[1:]), new.dtype)
    state[rows] = new
    return state
