"""What players are made of: one answer for many games, and draws from the stream of each game's own round."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np


class Batched:
    """Answers what it sees in a batch of games, or in one alone."""

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Play one step, of one game or of many; see :class:`fpg_bench.players.player.Player`."""
        if observation.ndim == 1:
            actions, state = self.predict(observation[None], state, episode_start)
            return actions[0], state
        return self._answer(observation, state, episode_start)

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        """What the player does in a batch of games; its policy has no other mode."""
        raise NotImplementedError


class SeededPolicy(Batched):
    """Keeps one key per game; a game that was never given one takes its own index.

    What a subclass answers treats every game by itself, and its memory is None, an array with a row per
    game, or a tuple of these. So it can be asked about some of its games only.
    """

    _keys = np.empty(0, np.uint64)

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Take the masked games' seeds for this round's draws."""
        if len(self._keys) != len(seeds):
            self._keys = np.zeros(len(seeds), np.uint64)
        self._keys[mask] = seeds[mask]

    def keys(self, count: int) -> np.ndarray:
        """``(count,)`` uint64, the present rounds' keys of the games that are asked about."""
        if len(self._keys) != count:
            self._keys = np.arange(count, dtype=np.uint64)
        return self._keys

    @contextlib.contextmanager
    def playing(self, games: np.ndarray, count: int) -> Iterator[None]:
        """Meanwhile play only these of ``count`` games, in this order, each with its own key."""
        whole = self.keys(count)
        self._keys = whole[games]
        try:
            yield
        finally:
            self._keys = whole

    def predict_rows(
        self,
        rows: np.ndarray,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Play one step of some games; the others' memory stays as it is.

        Args:
            rows: ``(k,)`` whole numbers, the games, each once.
            observation, state, episode_start, deterministic: of all n games, as ``predict`` takes them. The
                state is changed in place.

        Returns:
            Actions ``(k, 9)``, bit for bit what ``predict`` answers in these games, and the memory of all n.
        """
        count = len(observation)
        starts = None if episode_start is None else episode_start[rows]
        with self.playing(rows, count):
            actions, memory = self.predict(observation[rows], _taken(state, rows), starts, deterministic)
        return actions, _put(state, rows, memory, count)


def _taken(state: Any, rows: np.ndarray) -> Any:
    """A memory's rows of some games."""
    if isinstance(state, tuple):
        return tuple(_taken(part, rows) for part in state)
    return None if state is None else state[rows]


def _put(state: Any, rows: np.ndarray, found: Any, count: int) -> Any:
    """The memory of all games, with what was found in some of them; empty where no game was asked yet."""
    if isinstance(found, tuple):
        parts = [None] * len(found) if state is None else state
        return tuple(_put(part, rows, new, count) for part, new in zip(parts, found, strict=True))
    if found is None:
        return None
    if state is None:
        state = np.zeros((count, *found.shape[1:]), found.dtype)
    state[rows] = found
    return state
