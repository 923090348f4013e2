"""Players that draw at random: each game's draws come from the stream of its own round."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np


class Keyed:
    """Keeps one key per game; a game that was never given one takes its own index."""

    _keys = np.empty(0, np.uint64)

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Take the masked games' seeds for this round's draws."""
        if len(self._keys) != len(seeds):
            self._keys = np.zeros(len(seeds), np.uint64)
        self._keys[mask] = seeds[mask]

    def keys(self, count: int) -> np.ndarray:
        """``(count,)`` uint64, the present rounds' keys."""
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
