"""Whether each game is answered for itself: the same games are asked again in another order and company."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.players.agent import OnnxPlayer

DEPENDS = "its answer to one game depends on the other games of the batch"
_ROUNDING = 1e-4
# Another batch size may round the last bit otherwise, and a threshold turn that into another answer.
_ONE_IN, _FREE = 1000, 3


class Audit:
    """Asks a policy again what it has just been asked, each time in another order and in two parts.

    A policy cannot tell which of its calls are asked again, nor in what company.

    Args:
        player: the policy.

    Attributes:
        asked, other: how many games were asked again, and how many of them were answered otherwise.
    """

    def __init__(self, player: OnnxPlayer) -> None:
        self._player = player
        self.asked = self.other = 0

    def ask(
        self,
        seed: int,
        seen: np.ndarray,
        before: Any,
        starts: np.ndarray | None,
        actions: np.ndarray,
        after: Any,
    ) -> None:
        """Ask again.

        Args:
            seed: of the order and of where the batch is parted.
            seen, before, starts: what ``predict`` was told.
            actions, after: what it gave.

        Raises:
            RuntimeError: too many answers are others by now.
        """
        rng = np.random.default_rng(seed)
        count = len(seen)
        order = rng.permutation(count)
        cut = int(rng.integers(1, count)) if count > 1 else 1
        for games in (part for part in (order[:cut], order[cut:]) if len(part)):
            with self._player.playing(games, count):
                some = None if starts is None else starts[games]
                again, memory = self._player.predict(seen[games], _of(before, games), some)
            near = _near(again, actions[games]) & _near(
                _memory(memory, games), _memory(_of(after, games), games)
            )
            self.other += int((~near).sum())
        self.asked += count
        if self.other > _FREE + self.asked // _ONE_IN:
            raise RuntimeError(DEPENDS)


def _of(state: Any, games: np.ndarray) -> Any:
    """The memory of some games: of a network's own state, and of the steps that noise is drawn by."""
    return None if state is None else tuple(None if part is None else part[games] for part in state)


def _memory(state: Any, games: np.ndarray) -> np.ndarray:
    found = None if state is None else state[0]
    return np.zeros((len(games), 0), np.float32) if found is None else found


def _near(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """``(n,)``: which rows agree; those of another shape do not."""
    if one.shape != other.shape:
        return np.zeros(len(other), bool)
    found: np.ndarray = np.isclose(one, other, rtol=_ROUNDING, atol=_ROUNDING, equal_nan=True).all(axis=1)
    return found
