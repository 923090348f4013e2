"""Hostile JSON: texts that no reader of ours may take, crash on, or read long at."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from typing import Any

KINDS = ("deep", "digits", "surrogate", "twice", "constant", "endless", "cut", "bytes", "long", "words")


def hostile_texts(count: int, seed: int = 0, base: Any = None) -> Iterator[tuple[str, bytes]]:
    """So many texts, each with its kind, of this object or a small one; of every kind the same share."""
    rng = random.Random(seed)
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        yield kind, _text(kind, rng, dict(base or {"a": 1, "kind": "result", "lines": [1.5, None, "x"]}))


def hostile_text(base: dict[str, Any], rng: random.Random) -> bytes:
    """Return one text of a random kind."""
    *_, (_, text) = hostile_texts(1 + rng.randrange(len(KINDS)), rng.randrange(10**6), base)
    return text


def _text(kind: str, rng: random.Random, content: dict[str, Any]) -> bytes:
    key = rng.choice(list(content))
    value = _VALUES[kind](rng) if kind in _VALUES else None
    if value is not None:
        content[key] = "\0here"
        return json.dumps(content).replace('"\\u0000here"', value).encode("utf-8", "surrogatepass")
    data = json.dumps(content).encode()
    if kind == "cut":
        return data[: rng.randrange(len(data))]
    if kind == "twice":
        return data[:-1] + b", " + json.dumps(key).encode() + b": 2}"
    if kind == "bytes":
        place = rng.randrange(1, len(data))
        spoilt = rng.choice([b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\0", b"\x1b[2J"])
        return data[:place] + spoilt + data[place:]
    return _words(rng).encode()


def _deep(rng: random.Random) -> str:
    depth = rng.choice([51, 60, 200, 500, 990, 1000, 5000, 100_000])
    start, end = rng.choice([("[", "]"), ('{"a":', "}"), ('[{"a":', "}]")])
    return start * depth + "1" + end * depth


def _digits(rng: random.Random) -> str:
    many = "".join(rng.choices("123456789", k=rng.choice([41, 100, 400, 4299, 4300, 4301, 40_000])))
    return rng.choice(["", "-"]) + many + rng.choice(["", ".5", "e5", "." + many])


def _endless(rng: random.Random) -> str:
    return rng.choice(["1e309", "-1e400", "9e99999", "1E+" + "9" * 30, "[1e999]"])


def _surrogate(rng: random.Random) -> str:
    half = rng.choice(["\\ud800", "\\uDFFF", "\\udc00\\ud800", "a\\uD83d", "\\ud83d\\ud83d\\ude00"])
    return rng.choice(['"{}"', '{{"{}": 1}}', '["x", "{}"]']).format(half)


def _words(rng: random.Random) -> str:
    texts = [
        "",
        "null",
        "[]",
        "1",
        '"text"',
        "{'a': 1}",
        "{a: 1}",
        "\ufeff\ufeff{}",
        "{}{}",
        "undefined",
        " ",
    ]
    return rng.choice(texts)


_VALUES = {
    "deep": _deep,
    "digits": _digits,
    "endless": _endless,
    "surrogate": _surrogate,
    "constant": lambda rng: rng.choice(["NaN", "Infinity", "-Infinity", "[NaN]"]),
    "long": lambda rng: '"' + "x" * rng.choice([3_000_000, 5_000_000]) + '"',
}
