"""The player protocol: Stable-Baselines3's ``predict``, batched, and four optional members."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

SIDES = ("ally", "opponent")
Memory = Any  # what a player remembers of its rounds; only the player itself knows its type
Prediction = tuple[np.ndarray, Memory]  # actions, and the memory for the next step


@runtime_checkable
class Player(Protocol):
    """Anything that plays one side of a batch of n games; every SB3 model is a player.

    A player may also have these members. They are looked up once, when the player joins a game:

    * ``reset(mask, seeds)`` is called at the start of rounds, for players that draw at random: ``mask``
      (n,) bool selects the games whose rounds start, ``seeds`` (n,) uint64 come from each game's stream.
    * ``predict_rows(rows, ...)`` answers in some of the games only, if players are drawn per round; see
      :meth:`fpg_bench.players.seeded.SeededPolicy.predict_rows`.
    * ``sees = "state"`` marks an oracle. It gets the full state ``(n, 54)`` of
      :mod:`fpg_bench.game.full_state` instead of its observation, and is part of no suite.
    * ``flies = "pursuit"`` makes an opponent pursue the ally in games with the path ``learned``; by default
      it flies by its own actions there.
    """

    def predict(
        self,
        observation: np.ndarray,
        state: Memory = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Return actions ``(n, 9)`` float32 in [-1, 1], and the player's next memory.

        Args:
            observation: ``(n, 15)`` float32, the observations of the player's side, an array of its own.
            state: the memory that the last call returned; None at first.
            episode_start: ``(n,)`` bool, true where a round starts: memory is taken as empty there.
            deterministic: true for the mode of a stochastic policy.
        """
        ...


@runtime_checkable
class LosesRounds(Protocol):
    """A player that loses its current round by an invalid answer, as a submission does."""

    @property
    def invalid(self) -> np.ndarray:
        """``(n,)`` bool, the games whose current round is lost; empty before the first."""
        ...


PlayerSpec = str | os.PathLike[str] | Player  # a player, or its name


@dataclass(frozen=True)
class Abilities:
    """The optional members of a player; see :class:`Player`.

    Attributes:
        reset, predict_rows: its methods; None if it has none.
        sees_state: true for an oracle.
        pursues: true for an opponent that pursues the ally where others fly themselves.
        is_known: true for a class of :mod:`fpg_bench.players`, none of which writes into its observation.
    """

    reset: Callable[[np.ndarray, np.ndarray], None] | None
    predict_rows: Callable[..., Prediction] | None
    sees_state: bool
    pursues: bool
    is_known: bool

    @classmethod
    def of(cls, player: Player) -> Self:
        """Look up the optional members of a player."""
        return cls(
            getattr(player, "reset", None),
            getattr(player, "predict_rows", None),
            getattr(player, "sees", "") == "state",
            getattr(player, "flies", None) == "pursuit",
            type(player).__module__.startswith("fpg_bench.players."),
        )
