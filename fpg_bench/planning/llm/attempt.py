"""One attempt at a plan: what a language model was asked, what it answered, and what came of it."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass, fields
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.planning.llm.answers import read_answer
from fpg_bench.planning.llm.replies import read_body
from fpg_bench.planning.planner import Limits

UNANSWERED = ("timeout", "http", "budget")  # errors by which a model said nothing
_TOLD_APART = (*UNANSWERED, "refused")  # errors that have a status of their name
_SAID = ("text", "model", "tokens_in", "tokens_out")  # what a raw reply says, too

# The two attempts at a plan: the first, and the one that names the rule broken
FIRST, LAST = 0, 1

TOLERANCE = 0.02  # numbers in a prompt: another machine's last bits may round a reward the other way

Body = dict[str, Any]  # a request without headers
Where = tuple[int, int, int, int]  # seed, match, round, attempt


@dataclass(frozen=True)
class Attempt:
    """One attempt at the plan of one round.

    Attributes:
        seed, match, round, attempt: which it is.
        request: the body that was sent; None: no call was made.
        text: what the model wrote; None: nothing.
        error: what went wrong with the call (see :class:`fpg_bench.planning.llm.client.Reply`), or
            ``budget``: none was made; None: the model wrote something.
        detail: the error in words.
        waypoints: ``(n, 3)`` in m, as read from the text; None: no valid path.
        rung: which rung of the answer ladder read it.
        status: ``ok``, ``repaired``, ``invalid``, ``refused``, ``timeout``, ``http`` or ``budget``.
        prompt, prompt_hash, control: what the request was written with.
        calls: how many calls it took: what a server refuses is left out, and a 429 waited for, once.
        seconds: how long they took.
        tokens_in, tokens_out: as the server counts them; None: it does not.
        model: the model that answered, as the server says; the one asked for is in the request.
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
    calls: int = 0
    seconds: float = 0.0
    tokens_in: int | None = None
    tokens_out: int | None = None
    model: str | None = None

    @classmethod
    def of(cls, row: Row, where: str) -> Attempt:
        """The attempt in a row; the error of one that cannot be it begins with ``where``.

        Raises:
            UserError: a field is missing, or of another kind.
        """
        for name, kind in _KINDS.items():
            if name not in row or not isinstance(row[name], kind):
                raise UserError(f"{where} is no attempt: {name} is missing or changed")
        return cls(**{name: row[name] for name in _KINDS})

    def row(self) -> Row:
        """The row that :meth:`of` reads."""
        return {"kind": "attempt", "key": self.key, **asdict(self)}

    @property
    def key(self) -> str:
        """SHA-256 of the canonical request with seed, match, round and attempt."""
        content = json.dumps([self.request, *self.where], sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(content.encode()).hexdigest()

    @property
    def where(self) -> Where:
        """Seed, match, round and attempt."""
        return self.seed, self.match, self.round, self.attempt

    @property
    def asks_again(self) -> bool:
        """Whether the model is told what was wrong, and asked once more."""
        return self.attempt < LAST and self.error is None and self.waypoints is None

    def unlike(self, raw: Any) -> str | None:
        """What of this attempt is not as its raw reply says, where that was kept whole; None: nothing."""
        if self.text is None or not isinstance(raw, dict):
            return None
        said = read_body(raw)
        return next((name for name in _SAID if getattr(self, name) != getattr(said, name)), None)

    @property
    def tokens(self) -> int | None:
        """All tokens that the server counted; None: it counted none."""
        known = [count for count in (self.tokens_in, self.tokens_out) if count is not None]
        return sum(known) if known else None


def judge(text: str | None, error: str | None, limits: Limits) -> dict[str, Any]:
    """What a reply comes to: the fields ``waypoints``, ``rung`` and ``status`` of an attempt."""
    if error is not None or text is None:
        return {"waypoints": None, "rung": "none", "status": error if error in _TOLD_APART else "invalid"}
    answer = read_answer(text, limits)
    if answer.waypoints is None:
        return {"waypoints": None, "rung": answer.rung, "status": "refused" if answer.refused else "invalid"}
    status = "repaired" if answer.repaired else "ok"
    return {"waypoints": answer.waypoints.tolist(), "rung": answer.rung, "status": status}


_TYPES: dict[str, Any] = {"int": int, "str": str, "float": float | int, "Body | None": dict | None}
_TYPES |= {"int | None": int | None, "str | None": str | None, "list[list[float]] | None": list | None}
_KINDS = {field.name: _TYPES[str(field.type)] for field in fields(Attempt)}

_NUMBERS = re.compile(r"([-+]?[0-9]++(?:\.[0-9]++)?)")


def alike(asked: Any, recorded: Any) -> bool:
    """Whether two parts of requests agree: text outside numbers exactly, numbers within ``TOLERANCE``."""
    if type(asked) is not type(recorded):
        return False
    if isinstance(asked, dict):
        return asked.keys() == recorded.keys() and all(alike(asked[name], recorded[name]) for name in asked)
    if isinstance(asked, list):
        return len(asked) == len(recorded) and all(map(alike, asked, recorded))
    return bool(asked == recorded) or (isinstance(asked, str) and _alike_texts(asked, recorded))


def _alike_texts(asked: str, recorded: str) -> bool:
    x, y = _NUMBERS.split(asked), _NUMBERS.split(recorded)
    if len(x) != len(y) or x[::2] != y[::2]:
        return False
    pairs = zip(x[1::2], y[1::2], strict=True)
    return all(a == b or abs(float(a) - float(b)) <= TOLERANCE for a, b in pairs)
