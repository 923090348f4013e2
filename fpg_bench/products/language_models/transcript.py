"""Transcripts of a planning language model: one JSON row per attempt, so that anybody can replay a run.

Files are append-only. Rows have a ``kind``: ``attempt`` (a request with its answer) or ``flown`` (the plan
that a round flew, where planning runs beside the game); rows of other kinds are left as they are.

Nothing in a file proves who answered: it shows what was changed by accident, not what was made up.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import operator
import re
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, Field

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import PACKED, read_bounded
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import Expected, Strict, parse
from fpg_bench.common.strict_json import JsonObject, read_object
from fpg_bench.players.planner import Limits, Request
from fpg_bench.products.language_models.answers import read_answer
from fpg_bench.products.language_models.client import read_completion
from fpg_bench.products.language_models.prompts import PROMPTS

MODES = ("live", "record", "replay")
UNANSWERED = ("timeout", "http", "budget")  # errors without any answer of the model
FIRST, LAST = 0, 1  # the two attempts at a plan: the second one names the rule that the first broke
TOLERANCE = 0.02  # numbers in a prompt: another machine's last bits may round a reward the other way

# Bounds on transcripts of others
MOST_BYTES = 16_000_000  # of one transcript, unpacked; that of 4 matches is about 0.3 MB
MOST_LINES = 20_000
LONGEST_LINE = 1_000_000  # bytes

_OPTIONAL = ("seed", "response_format")  # fields of a request that a server may refuse
_IN_RAW = ("text", "model", "tokens_in", "tokens_out")  # fields that an attempt's raw reply holds, too
_NUMBERS = re.compile(r"([-+]?[0-9]++(?:\.[0-9]++)?)")
_logger = logging.getLogger(__name__)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(text)
    return text


Line = Annotated[
    str,
    Field(min_length=1, max_length=1000),
    AfterValidator(_printable),
    Expected("a line of at most 1000 characters"),
]
Body = JsonObject  # a request without headers
Where = tuple[int, int, int, int]  # seed, match, round, attempt
Place = tuple[int, int, int]  # seed, match, round


class Attempt(Strict, extra="ignore"):
    """One attempt at the plan of one round.

    Attributes:
        seed, match, round, attempt: its place in the run.
        request: the body that was sent; None: no call was made.
        text: the model's answer; None: none.
        error: of the call (see :class:`fpg_bench.products.language_models.client.Reply`), or ``budget``: no
            call was made; None: the model answered.
        detail: the error in words.
        waypoints: ``(n, 3)`` in m, as read from the text; None: no valid path.
        rung: the parser that read it.
        status: ``ok``, ``repaired``, ``invalid``, ``refused``, ``timeout``, ``http`` or ``budget``.
        prompt, prompt_hash, control: that the request was written with.
        calls: number of requests, those that were tried again included.
        seconds: duration of the calls.
        tokens_in, tokens_out: as the server counts them; None: it does not.
        model: the model that answered, as the server reports it; the one asked for is in the request.
    """

    seed: int
    match: int
    round: int
    attempt: int
    request: Body | None
    text: str | None
    error: str | None
    detail: str
    waypoints: list[list[float]] | None
    rung: str
    status: str
    prompt: str
    prompt_hash: str
    control: str
    calls: int
    seconds: float
    tokens_in: int | None
    tokens_out: int | None
    model: str | None

    def messages(self) -> Iterator[tuple[str, str]]:
        """Yield who says what: the messages of the request, then the answer or the error."""
        for message in (self.request or {}).get("messages", []):
            yield str(message.get("role")), str(message.get("content"))
        cost = f"{self.status}, {self.seconds:.1f} s, {self.tokens_out or 0} tokens"
        yield f"{self.model or 'no answer'} ({cost})", self.text or self.detail

    @classmethod
    def read(cls, row: Row, where: str) -> Attempt:
        """Return the attempt in a row.

        Raises:
            UserError: a field is missing, or of another type; ``where`` begins the message.
        """
        return parse(cls, row, f"{where} is not a valid attempt")

    def row(self) -> Row:
        """Return the row that :meth:`read` reads."""
        return {"kind": "attempt", "key": self.key, **self.model_dump()}

    @property
    def key(self) -> str:
        """SHA-256 of the canonical request with seed, match, round and attempt."""
        return _digest([self.request, *self.where])

    @property
    def where(self) -> Where:
        """Seed, match, round and attempt."""
        return self.seed, self.match, self.round, self.attempt

    @property
    def asks_again(self) -> bool:
        """True where the broken rule is sent to the model for a second attempt."""
        return self.attempt < LAST and self.error is None and self.waypoints is None

    @property
    def tokens(self) -> int | None:
        """All tokens that the server counted; None: it counted none."""
        counts = [count for count in (self.tokens_in, self.tokens_out) if count is not None]
        return sum(counts) if counts else None

    def changed_field(self, raw: object) -> str | None:
        """Return the first field that differs from the raw reply, where that was kept completely."""
        if self.text is None or not isinstance(raw, dict):
            return None
        reply = read_completion(raw)
        return next((name for name in _IN_RAW if getattr(self, name) != getattr(reply, name)), None)


class Header(Strict, extra="allow"):
    """Settings that all attempts of a run share; further keys are kept.

    Attributes:
        model: name of the model that was asked.
        control: what was withheld from it; ``none``: nothing.
        prompt_hash: hash of the prompt.
        temperature, sampling_seed: of sampling; runs of early versions do not say.
    """

    model: Line
    control: Line
    prompt_hash: Line
    temperature: int | float | None = None
    sampling_seed: int = 0

    def to_dict(self) -> dict[str, object]:
        """Return the keys that it was read from or made with."""
        return self.model_dump(exclude_unset=True)


class RunHeader(Header):
    """Content of ``planner.json``, beside the transcripts of a comparison.

    Attributes:
        server: name of the server's profile.
        prompt: the prompt, by name or as a file.
        suite, suite_hash, matches: the suite that is played, and its matches per ally.
        begun: time at which the run began.
        season, nonce: number of the season at that time, and a hash that could not be known before it.
    """

    server: Line
    prompt: Line
    suite: str
    suite_hash: Line
    matches: int
    begun: Line
    season: int | None = None
    nonce: str | None = ""


class Flown(Strict, extra="ignore"):
    """The plan that one round flew where planning runs beside the game.

    Attributes:
        seed, match, round: the round.
        plan: the key of the plan's deciding attempt, ``held`` or ``circle``.
        planned_round: the round for which it was requested; None: no new plan was flown.
    """

    seed: int
    match: int
    round: int
    plan: str | None
    planned_round: int | None


class Judged(NamedTuple):
    """Verdict on a reply: fields of an :class:`Attempt` of the same names."""

    waypoints: list[list[float]] | None
    rung: str
    status: str


def judge(text: str | None, error: str | None, limits: Limits) -> Judged:
    """Return the waypoints, rung and status of an attempt with this reply.

    Args:
        text, error: of the reply.
        limits: of the path that was asked for.
    """
    if error is not None or text is None:
        status = error if error in (*UNANSWERED, "refused") else "invalid"
        return Judged(None, "none", status)
    answer = read_answer(text, limits)
    if answer.waypoints is None:
        return Judged(None, answer.rung, "refused" if answer.refused else "invalid")
    status = "repaired" if answer.repaired else "ok"
    return Judged(answer.waypoints.tolist(), answer.rung, status)


def agree(asked: object, recorded: object) -> bool:
    """Return True if two requests' messages have the same text, and numbers in it within ``TOLERANCE``."""
    x, y = (_NUMBERS.split(json.dumps(messages, sort_keys=True)) for messages in (asked, recorded))
    if len(x) != len(y) or x[::2] != y[::2]:
        return False
    pairs = zip(x[1::2], y[1::2], strict=True)
    return all(a == b or abs(float(a) - float(b)) <= TOLERANCE for a, b in pairs)


def _digest(content: object) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def packed_rows(path: Path) -> list[Row]:
    """Return all rows of a transcript from outside; at most ``MOST_BYTES`` of it are held in memory.

    Args:
        path: the file, gzip-compressed where its name ends in ``.gz``.

    Raises:
        UserError: it cannot be read or unpacked, is too long, has a line that is too long or invalid, or ends
            in the middle of one.
    """
    data = read_bounded(path, "transcript", MOST_BYTES)
    if data.count(b"\n") > MOST_LINES:
        raise UserError(f"transcript {path}: has more than {MOST_LINES:,} lines")
    *lines, rest = data.split(b"\n")
    if rest:
        raise UserError(f"transcript {path}: is cut off in its last line")
    rows: list[Row] = []
    for number, line in enumerate(lines, 1):
        if len(line) > LONGEST_LINE:
            raise UserError(f"transcript {path}: line {number} is longer than {LONGEST_LINE:,} bytes")
        try:
            rows.append(read_object(line))
        except ValueError as error:
            raise UserError(f"transcript {path}: line {number} is not a valid row: {error}") from error
    return rows


def place_of(request: Request) -> Place:
    """Return a request's seed, match and round."""
    return request.seed, request.match, request.round


class Transcript:
    """The attempts at plans, kept in a file or (mode ``live``) in memory.

    A file is read when it is first needed; one that is written is locked for this process from then on. A
    copy shares its file; a pickle holds its name and mode alone.

    Args:
        path: the file; None in mode ``live``, and only there. One that is packed (``.gz``) can be replayed.
        mode: ``live``; ``record``: attempts in the file are used, all others are made and appended;
            ``replay``: all must be in the file.

    Raises:
        UserError: an unknown mode, a path in mode ``live`` or none in another; on first use: no such
            file to replay, another process writes it, or a line is broken.
    """

    def __init__(self, path: str | Path | None = None, mode: str = "live") -> None:
        if mode not in MODES:
            raise UserError(f"transcript: mode is {mode!r}; choose one of {', '.join(MODES)}")
        if (path is None) != (mode == "live"):
            needs = "keeps no file; choose record or replay" if path else "needs the transcript's file"
            raise UserError(f"transcript: mode {mode} {needs}")
        self.path = None if path is None else Path(path)
        if mode == "record" and self._is_packed:
            raise UserError(f"transcript {path}: is packed, and can only be replayed; unpack it to go on")
        self.mode = mode
        self._attempts: dict[Where, Attempt] | None = None
        self._flown: dict[Place, Flown] = {}
        self._held = contextlib.ExitStack()
        self._lock = threading.RLock()  # planning beside the game writes from two threads

    def __deepcopy__(self, memo: object) -> Transcript:
        if self.path is not None:
            return self
        twin = Transcript()
        twin._attempts = dict(self._read())
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        return Transcript, (self.path, self.mode)

    def close(self) -> None:
        """Release the file for other processes; it is read again when it is next needed."""
        with self._lock:
            self._held.close()
            self._attempts = None
            self._flown.clear()

    def attempts(self) -> list[Attempt]:
        """Return all attempts, in the order of the file; in mode ``live`` those of the present matches."""
        return list(self._read().values())

    def first_prompt(self) -> str:
        """Return the prompt profile of the first attempt; ``standard`` if it is not one of the package's."""
        name = next((attempt.prompt for attempt in self.attempts()), None)
        return name if name in PROMPTS else "standard"

    def check_header(self, header: Header) -> None:
        """Check that every attempt was made with the model, prompt and control of the run's header.

        Raises:
            UserError: the first attempt that was not.
        """
        for attempt in self.attempts():
            model = header.model if attempt.request is None else attempt.request.get("model")
            used = {"model": model, "prompt_hash": attempt.prompt_hash, "control": attempt.control}
            for name, value in used.items():
                if value != (stated := getattr(header, name)):
                    problem = f"was recorded with {name} {value}, and not {stated} as its header says"
                    raise UserError(self.complaint(attempt.where, problem))

    def find(self, where: Where, body: Body) -> Attempt | None:
        """Return an attempt of the transcript, None if there is none yet.

        Args:
            where: seed, match, round and attempt.
            body: of the request; in a replay the messages are enough. The fields that both have must
                agree: text outside numbers exactly, numbers within 0.02.

        Raises:
            UserError: a replay lacks it, or it is the answer to another request.
        """
        attempt = None if self.path is None else self._read().get(where)
        if attempt is None:
            if self.mode == "replay":
                raise UserError(self.complaint(where, "is missing"))
            return None
        recorded = attempt.request or {}
        for name in sorted(body.keys() & recorded.keys() - {*_OPTIONAL}):
            fits = agree if name == "messages" else operator.eq
            if not fits(body[name], recorded[name]):
                by = f"prompt {attempt.prompt!r}, control {attempt.control!r}"
                raise UserError(self.complaint(where, f"was recorded with other {name} ({by})"))
        return attempt

    def add(self, attempt: Attempt, extra: Row) -> Attempt:
        """Append an attempt, with extra fields for its row; return the one that is kept.

        Two games that are alike may make the same attempt: the first answer counts.

        Raises:
            OSError: the row cannot be written; the file stays as it was.
        """
        with self._lock:
            attempts = self._read()
            if self.path is None:
                over = (attempt.seed, attempt.match - 1)
                for where in [where for where in attempts if where[:2] == over]:
                    del attempts[where]
                attempts[attempt.where] = attempt.model_copy(update={"request": None})  # which is long
            elif attempt.where in attempts:
                return attempts[attempt.where]
            else:
                RowFile(self.path).append([{**attempt.row(), **extra}])
                attempts[attempt.where] = attempt
            return attempt

    def decided(self, seed: int, match: int, round: int) -> Attempt | None:
        """Return the attempt that decided a round's plan; None: there is none, or it was cut short."""
        attempts = self._read()
        first = attempts.get((seed, match, round, FIRST))
        return attempts.get((seed, match, round, LAST)) if first is not None and first.asks_again else first

    def valid_before(self, request: Request) -> list[Attempt]:
        """Return the attempts of a request's match with a valid path, before its round, oldest first."""
        decided = (self.decided(request.seed, request.match, k) for k in range(request.round))
        return [attempt for attempt in decided if attempt is not None and attempt.waypoints is not None]

    def flown(self, request: Request) -> Flown | None:
        """Return the plan that a request's round flew; None: there is none yet.

        Raises:
            UserError: a replay lacks it.
        """
        with self._lock:
            self._read()
            plan = self._flown.get(place_of(request))
        if plan is None and self.mode == "replay":
            raise UserError(self.complaint(place_of(request), "has no row that says what was flown"))
        return plan

    def add_flown(self, plans: Sequence[Flown]) -> None:
        """Append the plans that some rounds flew."""
        with self._lock:
            self._read()
            if self.path is not None and plans:
                RowFile(self.path).append([{"kind": "flown", **plan.model_dump()} for plan in plans])
                self._flown |= {(plan.seed, plan.match, plan.round): plan for plan in plans}

    def complaint(self, where: Sequence[int], problem: str) -> str:
        """Return an error's text that names an attempt of this transcript, or a round."""
        names = ("seed", "match", "round", "attempt")
        place = ", ".join(f"{name} {value}" for name, value in zip(names, where, strict=False))
        mend = "repeat what was recorded" if self.mode == "replay" else "record into a new file"
        return f"transcript {self.path}: {place} {problem}; {mend}"

    @property
    def _is_packed(self) -> bool:
        return self.path is not None and self.path.suffix == PACKED

    def _read(self) -> dict[Where, Attempt]:
        with self._lock:
            if self._attempts is None:
                self._attempts = {} if self.path is None else self._load(self.path)
            return self._attempts

    def _load(self, path: Path) -> dict[Where, Attempt]:
        if self.mode == "record":
            self._held.enter_context(RowFile(path).locked())
        elif not path.is_file():
            raise UserError(f"transcript {path}: no such file to replay")
        attempts: dict[Where, Attempt] = {}
        rows = packed_rows(path) if self._is_packed else RowFile(path).read()
        for number, row in enumerate(rows, 1):
            where = f"transcript {path}: line {number}"
            if row.get("kind") == "flown":
                plan = parse(Flown, row, f"{where} is not a valid round")
                self._flown[plan.seed, plan.match, plan.round] = plan
            elif row.get("kind") == "attempt":
                attempt = Attempt.read(row, where)
                if name := attempt.changed_field(row.get("raw")):
                    problem = f"is changed: its {name} is not what its raw reply says"
                    raise UserError(self.complaint(attempt.where, problem))
                attempts.setdefault(attempt.where, attempt)
                if row.get("key") != attempt.key:
                    _logger.warning("%s: not the key of its request", where)
        return attempts
