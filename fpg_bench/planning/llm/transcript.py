"""The transcript of a language model that plans: one JSON line per attempt, so that anybody can replay it.

Only ever appended. Lines have a ``kind``: ``attempt`` (what was asked and answered), ``flown`` (which plan a
round flew, where planning runs beside the game); others are left as they are.
"""

from __future__ import annotations

import contextlib
import copy
import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import PACKED
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.planning.llm.attempt import FIRST, LAST, Attempt, Body, Where, alike
from fpg_bench.planning.llm.chain import KEY, follows, linked
from fpg_bench.planning.llm.packed import packed_rows
from fpg_bench.planning.llm.prompts import PROMPTS
from fpg_bench.planning.planner import Request

MODES = ("live", "record", "replay")
OPTIONAL = ("seed", "response_format")  # fields of a request that a server may refuse, and then go without

Place = tuple[int, int, int]  # seed, match, round
_LOG = logging.getLogger(__name__)


def place_of(request: Request) -> Place:
    """Which round of which match a request is for: seed, match and round."""
    return request.seed, request.match, request.round


class Transcript:
    """The attempts at plans, kept in a file or (mode ``live``) nowhere.

    A file is read when it is first needed; one that is written is held for this process from then on. A
    copy shares its file; pickling keeps name and mode alone.

    Args:
        path: the file; None in mode ``live``, and only there. One that is packed (``.gz``) can be replayed.
        mode: ``live``; ``record``: what is in the file is used, the rest is asked for and added;
            ``replay``: all must be in the file.
        chain: where the chain of hashes through its lines begins (see :mod:`fpg_bench.planning.llm.chain`);
            None: it has none.

    Raises:
        UserError: an unknown mode, a path where none belongs or none where one does; on first use: no such
            file to replay, another process writes it, or a line is broken.
    """

    def __init__(self, path: str | Path | None = None, mode: str = "live", chain: str | None = None) -> None:
        if mode not in MODES:
            raise UserError(f"transcript: mode is {mode!r}; choose one of {', '.join(MODES)}")
        if (path is None) != (mode == "live"):
            needs = "keeps no file; choose record or replay" if path else "needs the transcript's file"
            raise UserError(f"transcript: mode {mode} {needs}")
        self.path = None if path is None else Path(path)
        if mode == "record" and self._is_packed:
            raise UserError(f"transcript {path}: is packed, and can only be replayed; unpack it to go on")
        self.mode, self.chain = mode, chain
        self._link = chain  # of the last line
        self._attempts: dict[Where, Attempt] | None = None
        self._valid: dict[tuple[int, int], dict[int, Attempt]] = {}  # by seed and match, then by round
        self._flown: dict[Place, Row] = {}
        self._held = contextlib.ExitStack()
        self._lock = threading.RLock()  # planning beside the game writes from two threads

    def __deepcopy__(self, memo: Any) -> Transcript:
        if self.path is not None:
            return self
        twin = Transcript()
        twin._valid = copy.deepcopy(self._valid)
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        return Transcript, (self.path, self.mode, self.chain)

    def close(self) -> None:
        """Let other processes write the file; it is read again when it is next needed."""
        with self._lock:
            self._held.close()
            self._attempts = None
            self._valid.clear()
            self._flown.clear()

    def attempts(self) -> list[Attempt]:
        """All attempts, in the order of the file."""
        return list(self._read().values())

    @property
    def prompt(self) -> str:
        """The profile by which the first attempt was made; ``standard`` where that is none of ours."""
        used = next((attempt.prompt for attempt in self.attempts()), None)
        return used if used in PROMPTS else "standard"

    def check_told(self, told: Mapping[str, Any]) -> None:
        """Check that every attempt was made with the model, prompt and control that are told beside it.

        Args:
            told: ``model``, ``prompt_hash`` and ``control``.

        Raises:
            UserError: one was not, by name.
        """
        for attempt in self.attempts():
            model = told.get("model") if attempt.request is None else attempt.request.get("model")
            made = {"model": model, "prompt_hash": attempt.prompt_hash, "control": attempt.control}
            for name, value in made.items():
                if value != told.get(name):
                    what = f"was recorded with {name} {value}, and not {told.get(name)} as is told of all"
                    raise UserError(self.complaint(attempt.where, what))

    def find(self, where: Where, body: Body) -> Attempt | None:
        """The attempt in the transcript, None if there is none yet.

        Args:
            where: seed, match, round and attempt.
            body: what would be sent; in a replay the messages are enough. The fields that both have must
                agree: text outside numbers exactly, numbers within 0.02.

        Raises:
            UserError: in a replay there is none; or it is the answer to another request.
        """
        attempt = self._read().get(where)
        if attempt is None:
            if self.mode == "replay":
                raise UserError(self.complaint(where, "is missing"))
            return None
        for name in sorted(body.keys() & (attempt.request or {}).keys() - {*OPTIONAL}):
            if not alike(body[name], attempt.request[name]):  # type: ignore[index]
                by = f"prompt {attempt.prompt!r}, control {attempt.control!r}"
                raise UserError(self.complaint(where, f"was recorded with other {name} ({by})"))
        return attempt

    def add(self, attempt: Attempt, more: Row) -> Attempt:
        """Append an attempt, with more to keep in its line; gives the one that is kept.

        Two games that are alike may ask for the same: the first answer counts.

        Raises:
            OSError: the line cannot be written; nothing that was there is lost.
        """
        with self._lock:
            kept = self._read().get(attempt.where)
            if kept is not None:
                return kept
            if self.path is None:
                self._valid.pop((attempt.seed, attempt.match - 1), None)  # that match is over
            else:
                self._append(self.path, [{**attempt.row(), **more}])
                self._read()[attempt.where] = attempt
            self._note_path(attempt)
            return attempt

    def decided(self, request: Request) -> Attempt | None:
        """The attempt that decided a request's plan; None: there is none, or it was cut short."""
        attempts, place = self._read(), place_of(request)
        first = attempts.get((*place, FIRST))
        return attempts.get((*place, LAST)) if first is not None and first.asks_again else first

    def last_valid(self, request: Request) -> Attempt | None:
        """The latest attempt of a request's match, before its round, that came to a path; None: none did."""
        valid = self._valid_before(request)
        return valid[-1] if valid else None

    def paths(self, request: Request) -> list[np.ndarray]:
        """The valid paths, ``(n, 3)`` in m each, of a request's match before its round."""
        return [np.array(attempt.waypoints) for attempt in self._valid_before(request)]

    def _valid_before(self, request: Request) -> list[Attempt]:
        with self._lock:
            self._read()
            valid = self._valid.get((request.seed, request.match), {})
            return [valid[k] for k in sorted(valid) if k < request.round]

    def flown(self, request: Request) -> Row | None:
        """The line that says which plan the round of a request flew; None: there is none yet.

        Raises:
            UserError: there is none in a replay.
        """
        with self._lock:
            self._read()
            line = self._flown.get(place_of(request))
        if line is None and self.mode == "replay":
            raise UserError(self.complaint(place_of(request), "has no line that says what was flown"))
        return line

    def add_flown(self, rows: Sequence[Row]) -> None:
        """Append which plans some rounds flew; each row holds ``seed``, ``match`` and ``round``."""
        with self._lock:
            self._read()
            if self.path is not None and rows:
                self._append(self.path, [{"kind": "flown", **row} for row in rows])
                self._flown |= {_place(row): row for row in rows}

    def complaint(self, where: Sequence[int], what: str) -> str:
        """An error's text that names an attempt of this transcript, or a round."""
        names = ("seed", "match", "round", "attempt")
        named = ", ".join(f"{name} {value}" for name, value in zip(names, where, strict=False))
        mend = "repeat what was recorded" if self.mode == "replay" else "record into a new file"
        return f"transcript {self.path}: {named} {what}; {mend}"

    @property
    def _is_packed(self) -> bool:
        return self.path is not None and self.path.suffix == PACKED

    def _note_path(self, attempt: Attempt) -> None:
        rounds = self._valid.setdefault((attempt.seed, attempt.match), {})
        rounds.pop(attempt.round, None)
        if attempt.waypoints is not None:
            rounds[attempt.round] = replace(attempt, request=None)  # which is long, and not needed

    def _read(self) -> dict[Where, Attempt]:
        with self._lock:
            if self._attempts is None:
                self._attempts = {} if self.path is None else self._load(self.path)
            return self._attempts

    def _append(self, path: Path, rows: Sequence[Row]) -> None:
        """Write rows; the chain goes on once they are written."""
        link, chained = self._link, list(rows)
        for index, row in enumerate(rows):
            if link is not None:
                chained[index] = linked(link, row)
                link = chained[index][KEY]
        RowFile(path).append(chained)
        self._link = link

    def _load(self, path: Path) -> dict[Where, Attempt]:
        if self.mode == "record":
            self._held.enter_context(RowFile(path).locked())
        elif not path.is_file():
            raise UserError(f"transcript {path}: no such file to replay")
        found: dict[Where, Attempt] = {}
        rows = packed_rows(path) if self._is_packed else RowFile(path).read()
        self._link = self.chain
        for number, row in enumerate(rows, 1):
            if self._link is not None:
                self._link = follows(self._link, row, f"transcript {path}: line {number}")
            if row.get("kind") == "flown":
                self._flown[_checked_place(row, f"transcript {path}: line {number}")] = row
            elif row.get("kind") == "attempt":
                attempt = Attempt.of(row, f"transcript {path}: line {number}")
                if name := attempt.unlike(row.get("raw")):
                    what = f"is changed: its {name} is not what its raw reply says"
                    raise UserError(self.complaint(attempt.where, what))
                if found.setdefault(attempt.where, attempt) is attempt:
                    self._note_path(attempt)
                if row.get("key") != attempt.key:
                    _LOG.warning("transcript %s: line %d: not the key of its request", path, number)
        return found


def _place(row: Row) -> Place:
    return row["seed"], row["match"], row["round"]


def _checked_place(row: Row, where: str) -> Place:
    for name in ("seed", "match", "round", "planned_round", "plan"):
        kind = {"plan": str, "planned_round": int | None}.get(name, int)
        if name not in row or not isinstance(row[name], kind):
            raise UserError(f"{where} is no round flown: {name} is missing or changed")
    return _place(row)
