"""Memory: statistics of a player's own past, beside what it observes.

Checks come every ten to twenty seconds, so stacked frames do not reach back to the one before. These numbers
are computed step by step from the observations alone, by one definition for arrays, tensors and ONNX graphs:
it uses slices, ``+``, ``-``, ``*``, ``abs`` and ``clip``, and weights that are powers of two, so that all
three give the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from fpg_bench.game.sensing import KNOWN_AGE, KNOWN_FREQUENCY, OWN_FREQUENCY, SENSED_COVERS

MEMORY_SIZES: Mapping[str, int] = MappingProxyType({"ally": 6, "opponent": 7})


def remember(side: str, seen: Any, before: Any) -> list[Any]:
    """Return the columns ``(n, 1)`` of the memory after an observation, in [-1, 1].

    An ally's are its frequency; the seconds since a hop and since a hit, in 1/32; hits in a row, in 1/8; and
    the shares of hops and of hits, over about 16 s. An opponent's are the frequency that it knows, and that
    of the find before; 1 if the last find was elsewhere than the one before; finds in a row at the same
    point and elsewhere, in 1/4; the share of finds elsewhere, over about four; and the finds, in 1/16.

    Args:
        side: ``ally`` or ``opponent``; empty for nothing.
        seen: the observations ``(n, 15)``.
        before: the memory ``(n, k)`` before them; zero when a round begins.
    """
    return (_of_ally if side == "ally" else _of_opponent)(seen, before) if side else []


def _of_ally(seen: Any, before: Any) -> list[Any]:
    frequency, stayed, quiet, hits, hop_share, hit_share = (_column(before, k) for k in range(6))
    now = _column(seen, OWN_FREQUENCY)
    hop = _is_unlike(now, frequency) * _is_unlike(stayed + quiet + hits, 0)
    hit = _column(seen, SENSED_COVERS).clip(0, 1)
    return [
        now,
        (1 - hop) * (stayed + 1 / 32).clip(0, 1),
        (1 - hit) * (quiet + 1 / 32).clip(0, 1),
        hit * (hits + 1 / 8).clip(0, 1),
        hop_share + (hop - hop_share) * (1 / 16),
        hit_share + (hit - hit_share) * (1 / 16),
    ]


def _of_opponent(seen: Any, before: Any) -> list[Any]:
    known, place, was_elsewhere, same, elsewhere, share, finds = (_column(before, k) for k in range(7))
    now = _column(seen, KNOWN_FREQUENCY)
    found = 1 - _is_unlike(_column(seen, KNOWN_AGE), 0)
    again = found * _is_unlike(finds, 0)  # the first one has none before
    moved = _is_unlike(now, known)
    return [
        now,
        place + again * (known - place),
        was_elsewhere + again * (moved - was_elsewhere),
        again * (1 - moved) * (same + 1 / 4).clip(0, 1) + (1 - again) * same,
        again * moved * (elsewhere + 1 / 4).clip(0, 1) + (1 - again) * elsewhere,
        share + again * (moved - share) * (1 / 4),
        (finds + found * (1 / 16)).clip(0, 1),
    ]


def _column(values: Any, column: int) -> Any:
    return values[:, column : column + 1]


def _is_unlike(values: Any, others: Any) -> Any:
    """Return 1 where values differ, and 0 where they are equal; differences of observations exceed 1e-5."""
    return (abs(values - others) * 2.0**20).clip(0, 1)
