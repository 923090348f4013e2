"""Checks of values that users write, in files and in calls."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Collection, Mapping
from numbers import Integral, Real
from typing import Any

from fpg_bench.common.errors import UserError, meant, nearest, shown


def is_integer(value: object, least: int = 1) -> bool:
    """Return True for an integer of at least ``least``; a bool is not one."""
    return isinstance(value, Integral) and not isinstance(value, bool) and least <= int(value) < 2**63


def integer(value: object, where: str, least: int = 1) -> int:
    """Return the value if it is an integer of at least ``least``; raise UserError otherwise."""
    if not isinstance(value, Integral) or not is_integer(value, least):
        bound = "a whole number above 0" if least == 1 else f"a whole number, {least} or more"
        raise UserError(f"{where}: expected {bound}, got {shown(value)}")
    return int(value)


def finite(value: object, where: str) -> float:
    """Return a number as a float if it is finite and 0 or more; raise UserError otherwise."""
    with contextlib.suppress(OverflowError):
        if isinstance(value, Real) and not isinstance(value, bool) and 0 <= float(value) < math.inf:
            return float(value)
    raise UserError(f"{where}: expected a finite number, 0 or more, got {shown(value)}")


def of_kind(value: object, where: str, expected: str, *kinds: type) -> Any:
    """Return the value if it is of one of the kinds; raise UserError, with what was expected, otherwise."""
    if not isinstance(value, kinds):
        raise UserError(f"{where}: expected {expected}, got {shown(value)}")
    return value


def one_of(value: object, where: str, known: Collection[str]) -> str:
    """Return the value if it is one of the known words; raise UserError otherwise, naming the nearest."""
    if not isinstance(value, str) or value not in known:
        hint = meant(str(value), known)
        raise UserError(f"{where}: expected one of {', '.join(known)}, got {shown(value)}{hint}")
    return value


def mapping(value: object, where: str) -> Mapping[Any, Any]:
    """Return the value if it is a mapping; raise UserError otherwise."""
    known: Mapping[Any, Any] = of_kind(value, where, "a mapping", Mapping)
    return known


def check_keys(content: object, known: Collection[str], where: str, needed: Collection[str] = ()) -> None:
    """Raise UserError for an unknown key, naming the nearest known one, or for a missing key.

    Args:
        content: what was read; anything but a mapping is refused.
        known: allowed keys.
        where: beginning of the message.
        needed: required keys.
    """
    keys = mapping(content, where).keys()
    for key in keys:
        if key not in known:
            raise UserError(f"{where}: unknown key {key!r}{nearest(str(key), known)}")
    if missing := [key for key in needed if key not in keys]:
        raise UserError(f"{where}: lacks {', '.join(missing)}")


def title(text: str, where: str = "") -> str:
    """Return a name for people; one that begins otherwise could be a formula or markup where it is shown.

    Raises:
        UserError: it is not printable text that begins with a letter, a digit or ``_``.
    """
    if not re.match(r"\w", text) or not text.isprintable():
        expected = "printable text that begins with a letter or a digit"
        raise UserError(f"{where}expected {expected}, got {text!r:.60}")
    return text


def first_difference(now: object, then: object, where: str = "") -> tuple[str, object, object] | None:
    """Return the path and both values of the first thing in which two values differ; None if nothing does.

    >>> first_difference({"a": [1, 2], "b": 3}, {"a": [1, 4], "b": 0})
    ('a[1]', 2, 4)

    Args:
        now, then: the values; mappings and lists are compared item by item.
        where: the path to them.
    """
    inner: list[tuple[str, object, object]] = []
    if isinstance(now, dict) and isinstance(then, dict):
        inner = [(f"{where}.{key}" if where else key, now.get(key), then.get(key)) for key in {**now, **then}]
    elif isinstance(now, list | tuple) and isinstance(then, list | tuple) and len(now) == len(then):
        inner = [(f"{where}[{k}]", *both) for k, both in enumerate(zip(now, then, strict=True))]
    else:
        return None if now == then else (where, now, then)
    found = (first_difference(one, other, path) for path, one, other in inner)
    return next(filter(None, found), None)
