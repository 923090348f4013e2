"""The first difference between two values."""

from __future__ import annotations

from collections.abc import Collection


def first_difference(
    now: object, then: object, where: str = "", but: Collection[str] = ()
) -> tuple[str, object, object] | None:
    """Return the path and both values of the first thing in which two values differ; None if nothing does.

    >>> first_difference({"a": [1, 2], "b": 3}, {"a": [1, 4], "b": 0})
    ('a[1]', 2, 4)

    Args:
        now, then: the values; mappings and lists are compared item by item.
        where: the path to them.
        but: keys of the values themselves that are not compared.
    """
    inner: list[tuple[str, object, object]] = []
    if isinstance(now, dict) and isinstance(then, dict):
        keys = [key for key in {**now, **then} if key not in but]
        inner = [(f"{where}.{key}" if where else key, now.get(key), then.get(key)) for key in keys]
    elif isinstance(now, list | tuple) and isinstance(then, list | tuple) and len(now) == len(then):
        inner = [(f"{where}[{k}]", *both) for k, both in enumerate(zip(now, then, strict=True))]
    else:
        return None if now == then else (where, now, then)
    found = (first_difference(one, other, path) for path, one, other in inner)
    return next(filter(None, found), None)
