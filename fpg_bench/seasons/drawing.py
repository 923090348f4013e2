"""Draws that follow from a season's seed by SHA-256 alone: the same on every machine, in every version."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def digest(*words: object) -> str:
    """SHA-256 of words, as 64 hexadecimal digits; slashes part them."""
    return hashlib.sha256("/".join(map(str, words)).encode()).hexdigest()


def number(below: int, *words: object) -> int:
    """A whole number in [0, below)."""
    return int(digest(*words), 16) % below


def shuffled(items: Sequence[T], *words: object) -> list[T]:
    """The items in a drawn order."""
    order = sorted(range(len(items)), key=lambda i: digest(*words, i))
    return [items[i] for i in order]


def dealt(levels: Sequence[T], count: int, *words: object) -> list[T]:
    """One level for each of ``count``, in a drawn order; the first ones once more where they are too few."""
    return shuffled([levels[i % len(levels)] for i in range(count)], *words)
