"""Cheap signs that a planner knows more than it is told, or learns nothing; they hide no entry."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fpg_bench.evaluation.field import PLANNER, Field
from fpg_bench.evaluation.play import rounds, table_of
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.tracks import KNOWN, TRACKS
from fpg_bench.planning import BatchPlanner, Plan, Planner, Request, as_planner, plan_all
from fpg_bench.planning.llm.prompts import controlled
from fpg_bench.rows import Row

# The opponent's return a step that no planner exceeds in a match's first round, when it knows nothing yet, by
# the name of the field; scripts/measure_first_round.py measures it.
FIRST_ROUND = MappingProxyType({"planner-v1": 6.31})
_SHUFFLED = "shuffled-rewards"
_SAME_MODEL = ("model", "server", "prompt_hash", "matches")


def marked(board: Row, folder: str | Path) -> Row:
    """A board whose planners bear their marks, ``first_round`` and ``shuffled_rewards``.

    A mark is ``{"flagged": True, False or None, "says": ...}``; None where it could not be computed.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives.
        folder: the leaderboard's, where planners of the package are found that can be asked again.
    """
    return board | {
        "tracks": [
            _marked(table, Path(folder)) if table["key"] == PLANNER else table for table in board["tracks"]
        ]
    }


def first_round(row: Row, table: Row) -> Row:
    """The mark of a first round that scores above all that is possible before anything was learned.

    Args:
        row: an entry's.
        table: its track's, of the board.
    """
    name = next(field["name"] for field in table["fields"] if field["role"] == KNOWN)
    score = row["planner"]["curve"][0]
    if row["planner"]["tier"] == "ally":
        return _mark(None, "not asked of planners that are shown the ally's path")
    if name not in FIRST_ROUND:
        return _mark(None, f"not computed: what is possible there was not measured for the field {name}")
    if score["low"] is None:
        return _mark(None, "not computed: one match has no interval")
    zero, top = table["scale"]["zero"], table["scale"]["top"]
    most = 100 * (FIRST_ROUND[name] - zero) / (top - zero)
    where = f"{score['value']:.1f} [{score['low']:.1f}, {score['high']:.1f}]"
    if score["low"] > most:
        return _mark(True, f"scores {where} in first rounds; without a history {most:.1f} is the most")
    return _mark(False, f"{where} in first rounds, within what is possible without a history")


def shuffled_rewards(row: Row, rows: Sequence[Row], script: str | None) -> Row:
    """The mark of a planner that answers the same where the rewards of its history were dealt out anew.

    Args:
        row: an entry's.
        rows: of all entries of its table; a recorded model is compared with its control among them.
        script: the package's planner that it is, which can be asked again; None: it was recorded.
    """
    told = row["planner"]
    if told["tier"] != "history" or told.get("control", "none") != "none":
        return _mark(None, "not asked: it is not said to use its rewards")
    if script is not None:
        field = TRACKS[PLANNER].field
        alike = answers_alike(as_planner(script, field.scenario), field)
    else:
        controls = [other for other in rows if _is_control(other, told)]
        if not controls:
            return _mark(None, "not computed: a record cannot be asked again, and its control is not entered")
        alike = any(_flown(row) == _flown(other) for other in controls)
    return _mark(alike, "answers the same" if alike else "answers otherwise")


def answers_alike(planner: Planner, field: Field) -> bool:
    """Whether a planner's paths in a match are those that it plans where its past rewards are shuffled."""
    both = _Both(planner)
    table = table_of(both, field, field.counterparts[0], matches=1)
    return all(both.alike for _ in rounds(table, field))


class _Both(BatchPlanner):
    """Asks a planner twice, the second time with rewards shuffled; what it flies is the first."""

    def __init__(self, planner: Planner) -> None:
        self.name, self.tier = planner.name, planner.tier
        self.alike = True
        self._planner = planner

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """The plans of the planner."""
        other = [
            dataclasses.replace(r, history=controlled(r, _SHUFFLED), rng=copy.deepcopy(r.rng))
            for r in requests
        ]
        plans = plan_all(self._planner, requests)
        pairs = zip(plans, plan_all(self._planner, other), strict=True)
        self.alike &= all(np.array_equal(a.waypoints, b.waypoints) for a, b in pairs)
        return plans


def _marked(table: Row, folder: Path) -> Row:
    rows = table["rows"]
    return table | {
        "rows": [row if row["planner"] is None else _with_marks(row, table, folder) for row in rows]
    }


def _with_marks(row: Row, table: Row, folder: Path) -> Row:
    script = None
    if row["kind"] == "script":
        script = load_submission(folder / "submissions" / PLANNER / row["slug"], contract=False).script
    marks = {
        "first_round": first_round(row, table),
        "shuffled_rewards": shuffled_rewards(row, table["rows"], script),
    }
    return row | {"planner": row["planner"] | {"marks": marks}}


def _is_control(other: Row, told: Mapping[str, Any]) -> bool:
    """Whether an entry is the control of a recorded model: the same, told shuffled rewards."""
    found = other["planner"] or {}
    same = all(found.get(key) == told.get(key) for key in _SAME_MODEL)
    return same and found.get("control") == _SHUFFLED


def _flown(row: Row) -> Row:
    """What an entry's flights came to; equal flights are equal in all of it."""
    return {"curve": row["planner"]["curve"], "measures": row["measures"]}


def _mark(flagged: bool | None, says: str) -> Row:
    return {"flagged": flagged, "says": says}
