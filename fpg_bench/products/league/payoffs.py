"""Pay-offs: who earns what from whom by the records of a store, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.evaluation.statistics import MATCHES, Interval, mean_interval, nash
from fpg_bench.evaluation.store import Pairing, Store


@dataclass(frozen=True)
class Payoffs:
    """Rewards per step of players against rivals.

    >>> tone, sweep = np.array([[[9.0, 2.0]]]), np.array([[[4.0, 5.0], [4.0, 7.0]]])
    >>> payoffs = Payoffs(("tone", "sweep"), ("idle", "expert"), (tone, sweep))
    >>> payoffs.values.tolist()
    [[9.0, 2.0], [4.0, 6.0]]
    >>> payoffs.worst("tone")[0]
    'expert'
    >>> {name: round(share, 2) for name, share in payoffs.equilibrium().players.items()}
    {'tone': 0.22, 'sweep': 0.78}

    Attributes:
        players: names of the players, the rows.
        rivals: names of the rivals, the columns.
        samples: of each player ``(training seeds, matches, rivals)``.
    """

    players: tuple[str, ...]
    rivals: tuple[str, ...]
    samples: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, store: Store, wanted: Sequence[Pairing]) -> Payoffs:
        """Return the pay-offs of pairings that a store has, in the order of their players and rivals.

        Entries of one name are training seeds of one player.

        Raises:
            UserError: a record is missing, or a pairing of one of the players with one of the rivals.
        """
        cells: dict[tuple[str, str], list[np.ndarray]] = {}
        for (entry, suite, rival), record in zip(wanted, store.of(wanted), strict=True):
            cells.setdefault((entry.name, rival.name), []).append(suite.rewards(record.returns))
        players, rivals = (tuple(dict.fromkeys(names)) for names in zip(*cells, strict=True))
        runs = {player: max(len(of) for (one, _), of in cells.items() if one == player) for player in players}
        for pair in product(players, rivals):
            if len(cells.get(pair, ())) != runs[pair[0]]:
                raise UserError(
                    f"pay-offs: {' against '.join(pair)} is missing, or one of its training seeds"
                )
        samples = [np.moveaxis(np.array([cells[one, rival] for rival in rivals]), 0, -1) for one in players]
        return cls(players, rivals, tuple(samples))

    @cached_property
    def values(self) -> np.ndarray:
        """The mean rewards ``(players, rivals)``."""
        return np.array([of.mean(axis=(0, 1)) for of in self.samples])

    def interval(self, player: str, rivals: str | Mapping[str, float]) -> Interval:
        """Return what a player earns from a rival, or from a mixture of rivals by their shares.

        Raises:
            UserError: no such player or rival.
        """
        row = _index(player, self.players, "player")
        shares = {rivals: 1.0} if isinstance(rivals, str) else rivals
        columns = [_index(name, self.rivals, "rival") for name in shares]
        return mean_interval(self.samples[row].mean(axis=0)[..., columns] @ [*shares.values()], MATCHES)

    def worst(self, player: str) -> tuple[str, Interval]:
        """Return the rival that a player earns least from, and what it earns there."""
        row = self.values[_index(player, self.players, "player")]
        rival = self.rivals[int(row.argmin())]
        return rival, self.interval(player, rival)

    def equilibrium(self) -> Equilibrium:
        """Return the Nash equilibrium of the zero-sum game in which rivals lose what players earn."""
        solution = nash(-self.values)
        return Equilibrium(
            dict(zip(self.players, solution.rows.tolist(), strict=True)),
            dict(zip(self.rivals, solution.columns.tolist(), strict=True)),
            -solution.value,
        )


class Equilibrium(NamedTuple):
    """Shares of players and of rivals, and what the players earn on average."""

    players: dict[str, float]
    rivals: dict[str, float]
    value: float


def _index(name: str, names: Sequence[str], what: str) -> int:
    if name not in names:
        raise UserError(f"pay-offs: no {what} {name!r}{nearest(name, names)}")
    return names.index(name)
