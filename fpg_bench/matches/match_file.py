"""A match in a file: what is played, what its planner was told and said, and what each round came to."""

from __future__ import annotations

import json
import platform
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.rows import Row, RowFile
from fpg_bench.version import __version__

RUN, ROUND = "run", "round"
_TOLD = {"planner": str, "ally": str, "opponent": str, "seed": int, "scenario": dict, "scenario_hash": str}
_SHOWN = 80  # characters of a value in an error
_UNTIMED = "seconds"  # how long planning took is no part of what a replay repeats


@dataclass(frozen=True)
class Match:
    """What is played.

    Attributes:
        planner, ally, opponent: who plans and who plays, by name.
        scenario: where, and how many rounds.
        seed: decides the match.
        llm: model, server, prompt and control of a planner that asks a language model, else None.
    """

    planner: str
    ally: str
    opponent: str
    scenario: Scenario
    seed: int
    llm: dict[str, Any] | None = None

    @property
    def rounds(self) -> int:
        """How many rounds the match has."""
        return self.scenario.rounds_per_match

    def row(self) -> Row:
        """The file's first line."""
        scenario = {spec.name: getattr(self.scenario, spec.name) for spec in fields(self.scenario)}
        row: Row = {"kind": RUN, "planner": self.planner, "ally": self.ally, "opponent": self.opponent}
        row |= {"seed": self.seed, "rounds": self.rounds, "llm": self.llm, "versions": versions()}
        row |= {"scenario": scenario, "scenario_hash": self.scenario.hash}
        return _as_written(row)


def versions() -> dict[str, str]:
    """What a match is played with."""
    return {"fpg_bench": __version__, "numpy": np.__version__, "python": platform.python_version()}


class MatchFile:
    """The append-only file of one match: its header, its rounds, and whatever lines a planner adds.

    Args:
        path: the file; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = RowFile(path)
        self.locked = self._file.locked
        self._versions = ""  # how those that wrote the file differ from the present ones

    def begin(self, match: Match) -> list[Row]:
        """Write the header, or check that it is this match's; gives the rounds that are there already.

        Raises:
            UserError: the file holds something else; the first difference is named.
        """
        rows = self._file.read()
        if not rows:
            self._file.append([match.row()])
            return []
        known, asked = self._header(rows), match.row()
        if len(rows) == 1:  # nothing was played: a language model that could not be asked, for one
            self.path.write_bytes(b"")
            self._file.append([asked])
            return []
        difference = _difference(known, asked, but="versions")
        if difference:
            raise UserError(f"match {self.path}: is another match, {difference}; name another file or folder")
        return self._rounds(rows)

    def read(self) -> tuple[Match, list[Row]]:
        """The match and all its rounds.

        Raises:
            UserError: no file of a match, or one whose rounds are not all there, which is named.
        """
        if self.path.is_dir():
            raise UserError(f"match {self.path}: is a folder; name its match.jsonl")
        if not self.path.is_file():
            raise UserError(f"match {self.path}: no such file; plan run writes one")
        rows = self._file.read()
        match, rounds = self._match(self._header(rows)), self._rounds(rows)
        if len(rounds) < match.rounds:
            raise UserError(
                f"match {self.path}: round {len(rounds)} is missing, or its line was cut off; the same "
                "plan run again goes on with it"
            )
        return match, rounds

    def add(self, row: Row) -> None:
        """Keep a round."""
        self._file.append([row])

    def check(self, known: Row, played: Row) -> None:
        """Check that a round was played as it stands in the file.

        Raises:
            UserError: it was not; the round and the first difference are named.
        """
        difference = _difference(known, _as_written(played), but=_UNTIMED)
        if not isinstance(known.get(_UNTIMED), int | float):
            difference = difference or f"{_UNTIMED} is {known.get(_UNTIMED)!r}"
        if lacking := played.keys() - known.keys():
            difference = difference or f"{min(lacking)} is missing"
        if difference:
            raise UserError(
                f"match {self.path}: round {played['round']} differs: {difference}{self._versions}"
            )

    def _header(self, rows: list[Row]) -> Row:
        head = rows[0] if rows else {}
        if head.get("kind") != RUN or any(not isinstance(head.get(key), kind) for key, kind in _TOLD.items()):
            raise UserError(f"match {self.path}: holds no match; name a file that plan run has written")
        other = _difference(head.get("versions"), versions(), "versions")
        self._versions = f"; {other}" if other else ""
        return head

    def _match(self, head: Row) -> Match:
        try:
            scenario = Scenario(**head["scenario"])
        except (TypeError, UserError) as error:
            raise UserError(f"match {self.path}: its scenario cannot be played: {error}") from error
        if (scenario.hash, scenario.rounds_per_match) != (head["scenario_hash"], head.get("rounds")):
            raise UserError(f"match {self.path}: its scenario is not the one it was played in")
        named = {key: head[key] for key in ("planner", "ally", "opponent", "seed")}
        return Match(scenario=scenario, llm=head.get("llm"), **named)

    def _rounds(self, rows: list[Row]) -> list[Row]:
        """The round lines, which stand in order from round 0."""
        rounds = [row for row in rows if row.get("kind") == ROUND]
        for index, row in enumerate(rounds):
            if row.get("round") != index:
                found = f"in its place stands round {row.get('round')}"
                raise UserError(f"match {self.path}: round {index} is missing; {found}")
        return rounds


def _as_written(row: Row) -> Row:
    """A row as a file gives it back: lists for tuples."""
    return json.loads(json.dumps(row))


def _difference(known: Any, now: Any, where: str = "", but: str = "") -> str:
    """The first place in which a value of the file differs from the present one, and both; else nothing."""
    if isinstance(known, dict) and isinstance(now, dict):
        inner = [(f"{where}.{key}" if where else key, key) for key in {**now, **known} if key != but]
        found = (_difference(known.get(key), now.get(key), name) for name, key in inner)
        return next(filter(None, found), "")
    if isinstance(known, list) and isinstance(now, list) and len(known) == len(now):
        pairs = enumerate(zip(known, now, strict=True))
        return next(filter(None, (_difference(*pair, f"{where}[{i}]") for i, pair in pairs)), "")
    return "" if known == now else f"{where} is {_short(known)} in the file, {_short(now)} now"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."
