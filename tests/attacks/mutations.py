"""Content of files in which one thing is wrong: a type, a range, a spelling, or a key that lacks."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

Place = tuple[str | int, ...]
HUGE = 10**400
WRONG: dict[type, tuple[Any, ...]] = {
    bool: ("yes", 3, None, [True], {}),
    int: ("many", True, [2], {"a": 1}, 1.5, -1, 0, HUGE, float("nan"), float("inf"), 1e308),
    float: ("much", True, [0.5, 0.5], {"a": 0.5}, -1.0, 1e308, HUGE, float("nan"), float("inf")),
    str: (7, 2.5, True, [], {}, "", "nonsense", "\x1b[2J\n\u202e", "x" * 5000, "\ud800", None),
    list: ("text", 5, {"a": 1}, True, [[]], [None], [HUGE]),
    dict: ("text", 5, [1], True, None, {"nonsense": 1}, {7: 1}, {None: 1}),
    type(None): ("text", [], {}, -1, True),
}


def places(content: Any, here: Place = ()) -> Iterator[Place]:
    """All places in a content: of mappings, lists and values."""
    if here:
        yield here
    if isinstance(content, dict):
        for key, value in content.items():
            yield from places(value, (*here, key))
    elif isinstance(content, list):
        for index, value in enumerate(content[:3]):
            yield from places(value, (*here, index))


def value_at(content: Any, place: Place) -> Any:
    """The value at a place."""
    for part in place:
        content = content[part]
    return content


def replaced(content: Any, place: Place, value: Any) -> Any:
    """A copy of a content with another value at a place."""
    content = copy.deepcopy(content)
    value_at(content, place[:-1])[place[-1]] = value
    return content


def renamed(content: Any, place: Place, name: Any) -> Any:
    """A copy of a content in which a key has another name."""
    content = copy.deepcopy(content)
    inner = value_at(content, place[:-1])
    items = [(name if key == place[-1] else key, value) for key, value in inner.items()]
    inner.clear()
    inner.update(items)
    return content


def misspelt(name: str) -> str:
    """A name with two letters swapped, or doubled."""
    return name[:1] + name[2:3] + name[1:2] + name[3:] if name[1:2] != name[2:3] else name + name[-1:]


def mutations(content: Any) -> Iterator[tuple[str, Place, Any]]:
    """Each content in which one thing is wrong, with what is wrong and where."""
    for place in places(content):
        value = value_at(content, place)
        for wrong in WRONG[type(value)]:
            yield f"{wrong!r:.30}", place, replaced(content, place, wrong)
        if isinstance(name := place[-1], str):
            yield "misspelt", place, renamed(content, place, misspelt(name))
            without = copy.deepcopy(content)
            del value_at(without, place[:-1])[name]
            yield "missing", place, without
