"""The readings that decide, trained: those under which the screen finds a claim that turns.

They are compared with the preset ``figures``, under which most claims come out between scripts. A cell is
one of its neighbours, which settle one point otherwise, or the letter. What is trained there are the
conditions of the claims that turn. Exploration is an axis as well: noise of 5 MHz on the jammer's frequency
hides a tone, whose half width is 2.5 MHz.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.paper.conditions import BASE, NO_KNOWLEDGE, NO_PLANNER, Condition, conditions_of
from fpg_bench.paper.readings import LETTER, POINTS, Reading, as_reading
from fpg_bench.paper.runs import Results

PRESET = "paper"  # whose readings they are
FIGURES = as_reading("interference=once,hops=always,hop-cost=0,memory=for-ever")
LOW_NOISE = 0.04  # on actions in [-1, 1]: 2 MHz of the jammer's frequency
# What has to be trained for a claim; D1 is asked of frozen pairs.
NEEDED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "D1": (BASE,),
        "D2": (BASE,),
        "D3 level": JAMMING_TYPES,
        "D3 order": JAMMING_TYPES,
        "D4 knowledge": (BASE, NO_KNOWLEDGE),
        "D4 planner": (BASE, NO_PLANNER),
    }
)


@dataclass(frozen=True)
class Cell:
    """A reading, and what is trained under it.

    Attributes:
        reading: which.
        claims: those that are asked, of :data:`NEEDED`.
        noise_sd: standard deviation of the exploration noise on actions in [-1, 1]; None: the usual one.
    """

    reading: Reading
    claims: tuple[str, ...]
    noise_sd: float | None = None

    @property
    def name(self) -> str:
        """The reading's, and the noise if it is another one."""
        return self.reading.name if self.noise_sd is None else f"{self.reading.name},noise={self.noise_sd}"

    @property
    def conditions(self) -> list[Condition]:
        """What is trained, by names that hold the cell's."""
        known = {condition.name: condition for condition in conditions_of("all", PRESET, full=False)}
        asked = {name: None for claim in self.claims for name in NEEDED[claim]}
        return [self._under(known[name]) for name in asked]

    def results(self, results: Results) -> Results:
        """The runs under it, by the names that its conditions have elsewhere."""
        start = self._named("")
        runs, about = (_without(start, each) for each in (results.runs, results.about))
        return Results(runs, about)

    def _under(self, condition: Condition) -> Condition:
        reading = self.reading
        changes = reading.changes | {"rounds_per_match": reading.rounds} | dict(condition.changes)
        words = {} if self.noise_sd is None else {"noise_sd": self.noise_sd}
        return replace(condition, name=self._named(condition.name), changes=changes, algorithm=words)

    def _named(self, condition: str) -> str:
        return f"{self.name}: {condition}"


def neighbours(reading: Reading) -> Iterator[Reading]:
    """The readings that settle one point otherwise."""
    for point, known in POINTS.items():
        for setting in known:
            if setting != reading.of(point):
                yield reading.but(**{point.replace("-", "_"): setting})


# The claims of a cell turn between scripts; a test holds this against the rows of the screen. H = 100 turns
# D3's level as well. But where each step is a hop, H takes 100 from the ally's reward and changes nothing.
CELLS = (
    Cell(as_reading(LETTER), tuple(NEEDED)),
    Cell(FIGURES.but(memory="match"), ("D1", "D2", "D4 planner")),
    Cell(FIGURES.but(hops="gated"), ("D2", "D4 knowledge")),
    Cell(FIGURES.but(interference="twice"), ("D2", "D3 order")),
    Cell(FIGURES, ("D3 order",), LOW_NOISE),
    Cell(as_reading(LETTER), ("D3 order",), LOW_NOISE),
)


def every_condition() -> list[Condition]:
    """What is trained under all of them, in the order in which it is run."""
    return [condition for cell in CELLS for condition in cell.conditions]


def names(conditions: Iterable[Condition]) -> list[str]:
    """What rows call their runs, swapped paths and all."""
    return [name for condition in conditions for name in condition.runs]


def _without(start: str, found: Mapping[str, Any]) -> dict[str, Any]:
    return {name.removeprefix(start): each for name, each in found.items() if name.startswith(start)}
