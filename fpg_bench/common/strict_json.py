"""The only reader of JSON from outside: strict, bounded, and the same for all readers."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

Json = Mapping[str, object]  # an object of JSON whose keys are not ours
JsonObject = dict[str, Any]  # one that is made, changed or looked into
LONGEST = 64_000_000  # bytes or characters
DEEPEST = 50  # brackets within brackets
MOST_DIGITS = 40  # of a number, its point and exponent included; a float has 24 at most
_ZEROS = bytes.maketrans(b".123456789", b"0" * 10)  # a run of digits is found faster than by an expression
# Of a number only where it may end: hexadecimal words are full of "e123".
_GREAT_EXPONENT = re.compile(r"[eE]\+?[0-9]{3,}+(?:[\s,}\]]|$)")
_HALF_PAIR = re.compile(r"\\u[dD][89a-fA-F]")


def read_plain(text: str | bytes, most: int = LONGEST, nan: bool = False, halves: bool = False) -> Any:
    """Return the content of a JSON text.

    Args:
        text: bytes are UTF-8, with or without a byte order mark.
        most: bytes or characters that it may have.
        nan: accept NaN and infinity, which Python writes although JSON does not define them.
        halves: accept lone surrogates, as in a text that was cut off.

    Raises:
        ValueError: it is not JSON, is too long or too deep, or holds a key twice, a number of too many digits
            or beyond all floats, or half of a surrogate pair. Nothing else is raised.
    """
    if len(text) > most:
        raise ValueError(f"longer than {most:,} {'bytes' if isinstance(text, bytes) else 'characters'}")
    text = text.decode("utf-8-sig") if isinstance(text, bytes) else text.removeprefix("\ufeff")
    checks: dict[str, Any] = {} if nan else {"parse_constant": _refuse}
    zeros = text.encode(errors="surrogatepass").translate(_ZEROS)
    if b"0" * (MOST_DIGITS + 1) in zeros or _GREAT_EXPONENT.search(text):
        checks |= {"parse_int": _whole, "parse_float": _real}
    try:
        content = json.loads(text, object_pairs_hook=_unique, **checks)
    except RecursionError:
        raise ValueError(f"more than {DEEPEST} brackets within brackets") from None
    if text.count("[") + text.count("{") > DEEPEST:
        _check_depth(content)
    if not halves and _HALF_PAIR.search(text):
        _check_letters(content)
    return content


def read_object(text: str | bytes, most: int = LONGEST, nan: bool = False) -> JsonObject:
    """Return the object in a JSON text; raises as :func:`read_plain`, and ValueError for anything else."""
    content = read_plain(text, most, nan)
    if not isinstance(content, dict):
        raise ValueError(f"expected an object in braces, got {type(content).__name__}")
    return content


def _unique(pairs: list[tuple[str, Any]]) -> JsonObject:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice = next(key for key, times in Counter(key for key, _ in pairs).items() if times > 1)
        raise ValueError(f"the key {twice[:60]!r} stands there twice")
    return content


def _whole(word: str) -> int:
    _check_digits(word)
    return int(word)


def _real(word: str) -> float:
    _check_digits(word)
    if not math.isfinite(value := float(word)):
        raise ValueError(f"{word} is beyond all numbers")
    return value


def _check_digits(word: str) -> None:
    if len(word) > MOST_DIGITS:
        raise ValueError(f"a number of {len(word):,} digits, at most {MOST_DIGITS} are read")


def _refuse(word: str) -> None:
    raise ValueError(f"{word} is not a valid number")


def _check_depth(content: object) -> None:
    """Raise ValueError if brackets are nested too deeply; without recursion."""
    level, depth = [content], 0
    while level := [part for item in level if isinstance(item, dict | list) for part in _parts(item)]:
        depth += 1
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} brackets within brackets")


def _parts(item: JsonObject | list[Any]) -> Any:
    return item.values() if isinstance(item, dict) else item


def _check_letters(content: object) -> None:
    """Raise ValueError for a lone surrogate, which cannot be written to a file."""
    try:
        json.dumps(content, ensure_ascii=False).encode("utf-8")
    except UnicodeEncodeError:
        raise ValueError("half of a surrogate pair, which is not a character") from None
