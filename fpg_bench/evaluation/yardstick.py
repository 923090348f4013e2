"""How good a policy is while it is trained or tuned: a panel's entries on tuning seeds, all as one batch."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, Reference, load_panel
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.statistics import iqm
from fpg_bench.game.measures import measures, pool
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning import as_planner
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import Player
from fpg_bench.players.seat import Seat

ROUNDS = 10
Acting = tuple[Callable[[np.ndarray], None], Callable[[], list[np.ndarray]]]


class Yardstick:
    """Scores a player of one side on a panel's entries; the same rounds for everybody.

    The random player (0) and the panel's reference (100) play them once, at the start.

    Args:
        panel: a panel's name, file, or the panel itself.
        rounds: rounds per entry, rounded up to whole matches.
        scenario: what is played instead of the panel's own; None: that.
        side: the side that must be measured; None: the panel's.

    Raises:
        UserError: no such panel, or one of the other side.
    """

    def __init__(
        self,
        panel: str | Panel,
        rounds: int = ROUNDS,
        scenario: Scenario | None = None,
        side: str | None = None,
    ) -> None:
        found = load_panel(panel, references=False) if isinstance(panel, str) else panel
        if side not in (None, found.side):
            raise UserError(f"panel {found.name}: measures the {found.side}, not the {side}")
        self.panel = found if scenario is None else dataclasses.replace(found, scenario=scenario)
        self._duels = [self._duel(entry, rounds) for entry in self.panel.entries]
        self._others = [
            self._seat(self.panel.other_side, entry.other, duel)
            for entry, duel in zip(self.panel.entries, self._duels, strict=True)
        ]
        played = [self._play(self._script(name))[0] for name in ("random", self.panel.reference)]
        self._references = [
            Reference(tuple(low.flat), tuple(high.flat)) for low, high in zip(*played, strict=True)
        ]

    def score(self, player: Player) -> dict[str, Any]:
        """What a player is worth.

        Returns:
            ``score``, the IQM over entries of the normalised score; ``return``, the mean of a round;
            ``entries``, the normalised score of each; ``measures``, pooled over all rounds.
        """
        returns, found = self._play(self._together(player))
        entries = self._normalised(returns).mean(axis=1)
        return {
            "score": _number(float(iqm(entries))),
            "return": round(float(returns.mean()), 3),
            "entries": {e.name: _number(s) for e, s in zip(self.panel.entries, entries, strict=True)},
            "measures": {name: None if x is None else round(x, 5) for name, x in found.items()},
        }

    def scores(self, player: Player) -> np.ndarray:
        """``(entries, matches)`` normalised scores of a player: 0 is random, 100 the panel's reference."""
        return self._normalised(self._play(self._together(player))[0])

    def _normalised(self, returns: np.ndarray) -> np.ndarray:
        """The normalised scores of ``(entries, rounds, matches)`` returns, ``(entries, matches)``.

        No finite numbers where the reference is worth just as much as the random player.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            found = [
                reference.scores(entry.ravel()).reshape(entry.shape).mean(axis=0)
                for reference, entry in zip(self._references, returns, strict=True)
            ]
        return np.array(found)

    def _duel(self, entry: Entry, rounds: int) -> Duel:
        scenario = self.panel.entry_scenario(entry)
        planner = None if entry.planner is None else as_planner(entry.planner, scenario)
        return Duel(scenario, -(-rounds // scenario.rounds_per_match), planner)

    def _seat(self, side: str, spec: Any, duel: Duel) -> Seat:
        return Seat(side, [as_player(spec, side, duel.scenario)], duel.arena)

    def _script(self, name: str) -> Acting:
        """A script, by a seat at every entry."""
        seats = [self._seat(self.panel.side, name, duel) for duel in self._duels]

        def begin(mask: np.ndarray) -> None:
            for seat, part in zip(seats, self._split(mask), strict=True):
                seat.begin(part)

        return begin, lambda: [seat.act() for seat in seats]

    def _together(self, player: Player) -> Acting:
        """A player that is asked about the games of all entries at once."""
        memory: Any = None
        starts = np.zeros(sum(duel.count for duel in self._duels), bool)
        views = [getattr(duel.arena, f"{self.panel.side}_observations") for duel in self._duels]

        def act() -> list[np.ndarray]:
            nonlocal memory
            actions, memory = player.predict(np.concatenate(views), memory, starts.copy(), True)
            starts[:] = False
            return self._split(actions)

        def begin(mask: np.ndarray) -> None:
            starts[mask] = True

        return begin, act

    def _split(self, whole: np.ndarray) -> list[np.ndarray]:
        return np.split(whole, np.cumsum([duel.count for duel in self._duels])[:-1])

    def _play(self, acting: Acting) -> tuple[np.ndarray, dict[str, float | None]]:
        """All rounds of new matches: returns ``(entries, rounds, matches)``, and the pooled measures."""
        begin, act = acting
        returns: list[list[np.ndarray]] = [[] for _ in self._duels]
        tallies, points = [], np.zeros(1)
        for number in range(self.panel.scenario.rounds_per_match):
            seeds = None if number else np.array(tuning_seeds(self._duels[0].count))
            begin(np.concatenate([duel.reset(seeds=seeds) for duel in self._duels]))
            for other, duel in zip(self._others, self._duels, strict=True):
                other.begin(np.ones(duel.count, bool))
            while not self._duels[0].arena.games["truncated"].all():
                self._step(act())
            for rounds, duel in zip(returns, self._duels, strict=True):
                tallies.append(duel.arena.tallies.copy())
                points = points + duel.arena.histograms.sum(axis=0)
                rounds.append(tallies[-1][f"{self.panel.side}_return"])
        return np.array(returns), measures(pool(np.concatenate(tallies)), points)

    def _step(self, actions: list[np.ndarray]) -> None:
        for own, other, duel in zip(actions, self._others, self._duels, strict=True):
            answer = other.act()
            duel.arena.step(*((own, answer) if self.panel.side == "ally" else (answer, own)))


def _number(value: float) -> float | None:
    """Rounded; None where there is none, in a game that tells nobody apart."""
    return round(value, 3) if math.isfinite(value) else None
