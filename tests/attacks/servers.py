"""Hostile servers of language models: they leak a key, fill a memory, end a run or paint a terminal."""

from __future__ import annotations

import gzip
import json
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tests.attacks.json_texts import hostile_text
from tests.planning.llm.fault_server import completion

PAINT = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202e\u2028\r"
STATUSES = (200, 200, 200, 201, 301, 400, 401, 404, 422, 429, 500, 503)


@dataclass(frozen=True)
class Hostile:
    """One answer: its status, headers and body."""

    status: int
    headers: dict[str, str]
    body: bytes


def hostile_answers(count: int, key: str, seed: int = 0) -> Iterator[tuple[str, Hostile]]:
    """So many answers, each with its kind.

    Args:
        count: how many.
        key: what the server was told, and may tell again.
        seed: of the draw.
    """
    rng = random.Random(seed)
    for number in range(count):
        name = list(_KINDS)[number % len(_KINDS)]
        body, headers = _KINDS[name](rng, key)
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        yield name, Hostile(rng.choice(STATUSES), headers, data)


def _echo(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """The key in one piece, somewhere, somehow written."""
    ways = [
        key,
        "".join(f"\\u{ord(c):04x}" for c in key),
        f"Bearer {key}",
        f"{key}{key}",
        f"{key[:4]}{key}{key[4:]}",
    ]
    text = rng.choice(ways)
    body = json.dumps(_somewhere(rng, "HERE")).replace("HERE", text)
    return (body.encode() if rng.random() < 0.7 else text.encode() + b"\xff"), {"X-Echo": key}


def _halves(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """The key in pieces that somebody may join."""
    cuts = sorted(rng.sample(range(1, len(key)), rng.randrange(1, 4)))
    pieces = [key[a:b] for a, b in zip([0, *cuts], [*cuts, len(key)], strict=True)]
    parts: list[Any] = [{"type": "text", "text": piece} for piece in pieces]
    if rng.random() < 0.3:
        parts.insert(1, rng.choice([7, None, "x", {"type": "image"}, {"text": ""}, []]))
    whole = completion(None, choices=[{"message": {"role": "assistant", "content": parts}}])
    where = rng.randrange(4)
    if where == 0:
        return whole, {}
    if where == 1:
        return {"error": {"message": pieces}}, {}
    if where == 2:
        return completion("Hello.", id=pieces, model=key[:3]), {}
    return {piece: number for number, piece in enumerate(pieces)} | {
        "choices": [{"message": {"content": "x"}}]
    }, {}


def _somewhere(rng: random.Random, word: str) -> Any:
    places: list[Any] = [
        completion(f"The key is {word}."),
        completion("Hello.", model=word),
        completion("Hello.", id=word),
        {"error": {"message": word, "code": word, "type": word}},
        {"error": word},
        {"detail": [{"loc": [word]}]},
        {"code": 10013, "message": word},
        completion(None, choices=[{"message": {"content": None, "refusal": word}}]),
        [word],
        word,
    ]
    return rng.choice(places)


def _tokens(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Counts of tokens that no run could add up."""
    many = rng.choice(
        ["9" * 4300, "9" * 4301, "-" + "1" * 400, "1e999", "1e308", "9" * 40, "9" * 19, "0.5", "true"]
    )
    body = json.dumps(completion("Hello.", usage={"prompt_tokens": "N", "completion_tokens": "N"}))
    return body.replace('"N"', many).encode(), {}


def _paint(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Characters that move a terminal, or that no file can hold."""
    word = rng.choice([PAINT, "\ud800", "a\udc00b" + PAINT, "\0", "\x7f" * 50])
    return _somewhere(rng, word), {}


def _bomb(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """A few kilobytes that unpack to megabytes; one in the other."""
    data = gzip.compress(b" " * 20_000_000, 9) if rng.random() < 0.3 else gzip.compress(b" " * 2_000_000, 9)
    encoding = "gzip"
    if rng.random() < 0.5:
        data, encoding = gzip.compress(data, 9), "gzip, gzip"
    return data, {"Content-Encoding": rng.choice([encoding, "deflate", "br", "zstd", encoding.upper()])}


def _long(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """More than is read."""
    start = json.dumps(completion(key))[:-40].encode()
    return start + rng.choice([b" ", b"[", b'"', b"9", b"\\ud800"]) * rng.choice([400_000, 1_500_000]), {}


def _json(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Hostile JSON of all kinds, as an answer."""
    return hostile_text(completion("Hello."), rng), {}


def _headers(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Headers that are none."""
    wait = rng.choice(["9" * 400, "1e999", "nan", "-1", "", "\u0663", "0." + "9" * 5000, "99999"])
    return completion("Hello."), {"Retry-After": wait.encode("utf-8").decode("latin-1")}


_KINDS = {
    "echo": _echo,
    "halves": _halves,
    "tokens": _tokens,
    "paint": _paint,
    "bomb": _bomb,
    "long": _long,
    "json": _json,
    "headers": _headers,
}
