"""The readings that decide, trained: the one that the screen names, each of its neighbours, and the letter.

A neighbour settles one point otherwise. So each of them says what hangs on that point where both sides learn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.reproduce.conditions import BASE, NO_KNOWLEDGE, NO_PLANNER, Condition, conditions_of
from fpg_bench.reproduce.readings import LETTER, POINTS, Reading, as_reading
from fpg_bench.reproduce.results import Results

PRESET = "paper"  # whose readings they are
FIGURES = as_reading("interference=once,hops=always,hop-cost=0,memory=for-ever")
# What a claim needs: D1 frozen and D2 the first, D3 the types, D4 the last two.
_ASKED = (BASE, *JAMMING_TYPES, NO_KNOWLEDGE, NO_PLANNER)


def neighbours(reading: Reading) -> Iterator[Reading]:
    """The readings that settle one point otherwise."""
    for point, known in POINTS.items():
        for setting in known:
            if setting != reading.of(point):
                yield reading.but(**{point.replace("-", "_"): setting})


def cells() -> list[Reading]:
    """The readings that are trained, in the order in which they are run."""
    return list(dict.fromkeys([FIGURES, as_reading(LETTER), *neighbours(FIGURES)]))


def cell_conditions(reading: Reading) -> list[Condition]:
    """What is trained under a reading, by names that hold the reading's."""
    known = {condition.name: condition for condition in conditions_of("all", PRESET, full=False)}
    return [_under(reading, known[name]) for name in _ASKED]


def every_condition() -> list[Condition]:
    """What is trained under all of them, the first reading first."""
    return [condition for reading in cells() for condition in cell_conditions(reading)]


def _under(reading: Reading, condition: Condition) -> Condition:
    changes = reading.changes | {"rounds_per_match": reading.rounds} | dict(condition.changes)
    return replace(condition, name=_named(reading, condition.name), changes=changes)


def _named(reading: Reading, condition: str) -> str:
    return f"{reading.name}: {condition}"


def results_of(reading: Reading, results: Results) -> Results:
    """The runs under a reading, by the names that its conditions have elsewhere."""
    start = _named(reading, "")
    runs, about = (_without(start, each) for each in (results.runs, results.about))
    return Results(runs, about)


def _without(start: str, found: Mapping[str, Any]) -> dict[str, Any]:
    return {name.removeprefix(start): each for name, each in found.items() if name.startswith(start)}


def names(conditions: Iterable[Condition]) -> list[str]:
    """What rows call their runs, swapped paths and all."""
    return [name for condition in conditions for name in condition.runs]
