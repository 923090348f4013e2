"""Both sides of N games whose rounds are kept as they end; what the windows of a run are made of."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.envs.core import JointGame

_KNOWLEDGE_GATE = 4


class Recorded(JointGame):
    """Both sides of N games; the ally asks the knowledge base whenever it hops (Algorithm 1, line 6).

    Args:
        games, **options: as for :class:`fpg_bench.envs.core.JointGame`.

    Attributes:
        played: steps so far, over all games.
        rounds: for each round that ended: ``played`` then, its record of dtype ``state.TALLY``, and its
            histogram ``(2, points)``.
    """

    def __init__(self, games: int = 1, **options: Any) -> None:
        super().__init__(games, **options)
        self.played = 0
        self.rounds: list[tuple[int, np.void, np.ndarray]] = []

    def step(self, actions: np.ndarray) -> None:
        """Play one step with ``(N, 18)`` actions."""
        actions = actions.copy()
        actions[:, _KNOWLEDGE_GATE] = 1
        super().step(actions)
        self.played += self.count

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Any = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Begin rounds; those that are over are kept first."""
        over = self.truncated if mask is None else self.truncated & mask
        batch = self.duel.batch
        for game in np.flatnonzero(over).tolist():
            self.rounds.append((self.played, batch.tallies[game].copy(), batch.histograms[game].copy()))
        super().reset(mask, seeds, new_match, horizons)
