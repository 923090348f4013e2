"""One way to play every kind of view, so that one contract holds for all of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.game.state import ACTION_SIZE


class Shown(NamedTuple):
    """What a step shows of N games, by whatever names the view has for it.

    Attributes:
        observations: ``(N, 15)`` of one side, ``(N, 30)`` of both; at a round's end those of its last step.
        rewards: ``(N,)`` of one side, ``(N, 2)`` of both.
        over: ``(N,)`` bool, the rounds that ended by truncation.
        terminated: whether any game has ended otherwise.
        returns: like ``rewards``, the rounds' returns as the measures say; None before their end.
        handed: the very arrays that the view gave.
    """

    observations: np.ndarray
    rewards: np.ndarray
    over: np.ndarray
    terminated: bool
    returns: np.ndarray | None
    handed: tuple[np.ndarray, ...]


class Hands:
    """A view in one's hands: N games of one side or of both.

    Args:
        view: it is new.

    Attributes:
        games: how many, N.
        shape: of one side's actions, as the view wants them.
        scenario: what is played.
    """

    sides: tuple[str, ...] = ()

    def __init__(self, view: Any) -> None:
        self.view = view
        self.games = 1
        self.shape: tuple[int, ...] = (ACTION_SIZE,)
        self.scenario = self._duel().scenario

    def _duel(self) -> Duel:
        return self.view.core.duel

    @property
    def width(self) -> int:
        """How many numbers a game's actions are, of all sides together."""
        return ACTION_SIZE * len(self.sides or (1,))

    def spaces(self) -> tuple[Any, ...]:
        """The spaces of one game's observations and actions, or none."""
        return self.view.observation_space, self.view.action_space

    def holds(self, observations: np.ndarray) -> bool:
        """Whether observations lie in their space."""
        return all(row in self.view.observation_space for row in observations)

    def reset(self, seed: Any = None) -> np.ndarray:
        """Begin a round in every game; gives the observations."""
        raise NotImplementedError

    def step(self, actions: Any) -> Shown:
        """Play a step; the actions go to the view as they are."""
        raise NotImplementedError

    def packed(self, actions: np.ndarray) -> Any:
        """Actions ``(N, width)`` as the view takes them."""
        return actions

    def next_round(self) -> None:
        """Begin the next round where the view does not by itself."""
