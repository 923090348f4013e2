"""What a player is: Stable-Baselines3's ``predict``, batched, and two optional extras."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

SIDES = ("ally", "opponent")


@runtime_checkable
class Player(Protocol):
    """Anything that plays one side: every SB3 model is one.

    Three optional attributes:

    * ``sees = "state"`` marks an oracle: it is handed the full state ``(n, 54)`` of
      :mod:`fpg_bench.game.full_state` instead of its observation and stands in no field.
    * ``reset(mask, seeds)`` is called at a round's start by whoever hosts a player that draws at random:
      ``mask`` (n,) bool, ``seeds`` (n,) uint64 from the game's own stream.
    * ``predict_rows(rows, ...)`` answers in some games only, where several players are drawn from; see
      :class:`fpg_bench.players.seeded.Keyed`.
    """

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Actions ``(n, 9)`` float32 in [-1, 1] for observations ``(n, 15)``, and the next memory.

        Args:
            observation: what the side sees, float32.
            state: the player's memory as its last call returned it, None at first.
            episode_start: ``(n,)`` bool, where a round starts: memory is taken as empty there.
            deterministic: whether to play the mode of a stochastic policy.
        """
        ...
