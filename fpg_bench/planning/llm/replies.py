"""What came back from a server of a language model, good or bad, read into one form."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from fpg_bench.common.errors import printable
from fpg_bench.common.strict_json import read_plain

ERRORS = ("timeout", "http", "refused", "invalid")
LONGEST_BODY = 1_000_000  # bytes; the rest is not read
MOST_TOKENS = 10**9  # of one answer; a server that counts more counts wrong
LONGEST_RAW = 10_000  # characters kept of a body that is no JSON
LONGEST_DETAIL = 200
_PAGE = "a web page"
_HOPELESS = (401, 403, 404, 405)  # and redirections, which are not followed
SHORTEST_SECRET = 8  # shorter keys are words such as "none" and "x", which stand in any text


@dataclass(frozen=True)
class Reply:
    """One answer of a language model, or why there is none. It never holds the key.

    Attributes:
        text: what the model wrote; None where ``error`` is set.
        error: None, or one of ``ERRORS``: the deadline passed; no connection, or an error of the server;
            the model or a filter would not answer; a reply that is no chat completion.
        detail: one line about the error, and about fields that were left out.
        raw: the body, as JSON; text, cut, where it is none; None where none came.
        model: the model that the server says has answered.
        tokens_in, tokens_out: as the server counts them.
        seconds: from the question to the answer.
        sent: the body of the request, as it was last sent.
        dropped: the fields that were left out of it because the server refuses them.
        calls: how many requests it took.
        hopeless: asking again cannot mend it: nobody listens, the key or the address is refused, or a web
            page stands in place of an answer.
    """

    text: str | None = None
    error: str | None = None
    detail: str = ""
    raw: Any = None
    model: str | None = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    seconds: float = 0.0
    sent: dict[str, Any] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    calls: int = 1
    hopeless: bool = False


@dataclass(frozen=True)
class Received:
    """A response as it came: status, the first bytes of its body, and Retry-After in seconds, if given."""

    status: int
    body: bytes
    retry_after_s: float | None = None


def read_reply(received: Received, secret: str | None, refusal_codes: tuple[int | str, ...]) -> Reply:
    """Read a response of any kind.

    Args:
        received: the response.
        secret: what must not stand in the reply: the key.
        refusal_codes: the codes of errors that mean a refusal.
    """
    body = _read(received.body[:LONGEST_BODY].decode("utf-8", "replace"), secret)
    words = "".join(_words(body))
    if without(secret, words) != words:
        return Reply(error="invalid", detail="the reply holds the key in pieces; nothing of it is kept")
    if received.status >= 300:
        reply = _failed(body, f"HTTP {received.status}{_advice(received.status)}", refusal_codes)
        lasting = received.status in _HOPELESS or received.status < 400
        return replace(reply, hopeless=lasting and reply.error == "http")
    if not isinstance(body, dict):
        what = _kind(received.body) if isinstance(body, str) else "other JSON"
        detail = f"the reply is no chat completion but {what}"
        return Reply(error="invalid", detail=detail, raw=body, hopeless=what == _PAGE)
    if not body.get("choices"):
        if body.get("error") or body.get("code"):
            return _failed(body, "an error in place of an answer", refusal_codes)
        return Reply(error="invalid", detail="the reply holds no choices", raw=body)
    return read_body(body)


def _read(text: str, secret: str | None) -> Any:
    """A body as JSON, else as text, without the key."""
    try:
        body = read_plain(text, halves=True)
        _join_parts(body)
        # Written and read again: an escaped key is found, and one whose parts were joined
        plain = json.dumps(body, ensure_ascii=False).encode("utf-8", "replace").decode()
        return read_plain(without(secret, plain))
    except ValueError:
        return without(secret, text)[:LONGEST_RAW]


def _join_parts(body: Any) -> None:
    """Make one text of the parts of each message's content."""
    choices = _object(body).get("choices")
    for choice in choices if isinstance(choices, list) else ():
        message = _object(_object(choice).get("message"))
        if isinstance(message.get("content"), list):
            message["content"] = _text(message["content"])


def _words(value: Any) -> Iterator[str]:
    """All texts in JSON, keys too, as they follow on one another."""
    if isinstance(value, str):
        yield value
    for part in value if isinstance(value, list) else _object(value).items():
        yield from _words(list(part) if isinstance(part, tuple) else part)


def read_body(body: dict[str, Any]) -> Reply:
    """Read a chat completion: the first choice's text, or why it has none."""
    choices = body.get("choices")
    choice = _object(choices[0] if isinstance(choices, list) else None)
    message, finish = _object(choice.get("message")), choice.get("finish_reason")
    reply = Reply(raw=body, model=_name(body.get("model")), **_tokens(body.get("usage")))
    if message.get("refusal") or finish == "content_filter":
        said = message.get("refusal") or "the server's filter held the answer back"
        return replace(reply, error="refused", detail=one_line(str(said)))
    text = _text(message.get("content"))
    if not text.strip():
        why = " (cut off at max_tokens)" if finish == "length" else ""
        return replace(reply, error="invalid", detail=f"the reply holds no text{why}")
    return replace(reply, text=text)


def without(secret: str | None, text: str) -> str:
    """``text`` with the key struck out, as it is and as JSON writes it; very short keys are left."""
    if secret is None or len(secret) < SHORTEST_SECRET:
        return text
    return text.replace(secret, "***").replace(json.dumps(secret)[1:-1], "***")


def one_line(text: str) -> str:
    """A text on one line, cut where it is long, without what would move a terminal."""
    line = printable(" ".join(text[: 4 * LONGEST_DETAIL].split()))
    return line if len(line) <= LONGEST_DETAIL else f"{line[: LONGEST_DETAIL - 1]}…"


def error_text(body: Any) -> str:
    """What a server says went wrong, in whichever of the common forms."""
    if not isinstance(body, dict):
        return "" if str(body).lstrip()[:1] == "<" else str(body or "")
    found = body.get("error") or body.get("detail") or body
    if isinstance(found, dict):
        found = found.get("message") or found
    return found if isinstance(found, str) else json.dumps(found)


def _failed(body: Any, what: str, refusal_codes: tuple[int | str, ...]) -> Reply:
    said = error_text(body)
    error = "refused" if _codes(body) & set(refusal_codes) else "http"
    return Reply(error=error, detail=one_line(f"{what}: {said}" if said else what), raw=body)


def _codes(body: Any) -> set[int | str]:
    """The codes of an error object, wherever they stand; numbers written as words are numbers."""
    outer = _object(body)
    codes = [part.get(key) for part in (outer, _object(outer.get("error"))) for key in ("code", "type")]
    words = [str(code) for code in codes]
    return {int(word) if word.isdecimal() and len(word) < 10 else word for word in words}


def _advice(status: int) -> str:
    if status in (401, 403):
        return ", the key is refused (FPG_LLM_API_KEY)"
    return ", no such address or model (FPG_LLM_BASE_URL, FPG_LLM_MODEL)" if status == 404 else ""


def _kind(body: bytes) -> str:
    if len(body) >= LONGEST_BODY:
        return f"more than {LONGEST_BODY} bytes"
    if body.lstrip()[:1] == b"<":
        return _PAGE
    return "cut or broken JSON" if body.strip() else "empty"


def _text(content: Any) -> str:
    """A message's content: a string, or the texts among its parts. Half a surrogate pair is no text."""
    if isinstance(content, list):
        content = "".join(str(part.get("text", "")) for part in content if isinstance(part, dict))
    return content.encode("utf-8", "replace").decode() if isinstance(content, str) else ""


def _name(model: Any) -> str | None:
    return one_line(model) if isinstance(model, str) and model else None


def _tokens(usage: Any) -> dict[str, Any]:
    counts = {"tokens_in": "prompt_tokens", "tokens_out": "completion_tokens"}
    told = {name: _object(usage).get(key) for name, key in counts.items()}
    return {
        name: count if type(count) is int and 0 <= count <= MOST_TOKENS else None
        for name, count in told.items()
    }


def _object(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
