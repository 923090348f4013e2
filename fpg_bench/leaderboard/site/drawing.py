"""Small pictures as numbers: where the lines of an interval and the bars of a histogram stand, in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fpg_bench.leaderboard.site.shown import Score
from fpg_bench.leaderboard.site.wording import finite

WIDTH = 130  # of an interval's picture
MARGIN = 5
HEAT_STEPS = 9
Domain = tuple[float, float]


def domain_of(intervals: Sequence[Score | None]) -> Domain:
    """The scores that a column of pictures spans: 0 and 100, and all that is shown."""
    numbers = [0.0, 100.0, *ends_of(intervals)]
    return min(numbers), max(numbers)


def ends_of(intervals: Sequence[Score | None]) -> list[float]:
    """All values and ends of intervals that have a value."""
    known = [interval for interval in intervals if interval is not None and interval.value is not None]
    found = [end for interval in known for end in (interval.value, interval.low, interval.high)]
    return [end for end in found if end is not None]


def place(value: float, domain: Domain) -> float:
    """Where a value stands."""
    low, high = domain
    return round(MARGIN + (value - low) / (high - low) * (WIDTH - 2 * MARGIN), 1)


def interval_picture(interval: Score | None, domain: Domain) -> dict[str, float] | None:
    """Where an interval's dot and ends stand, and the marks of 0 and 100; None without a value."""
    value = None if interval is None else interval.value
    if interval is None or value is None:
        return None
    low, high = interval.low, interval.high
    ends = (value, value) if low is None or high is None else (low, high)
    drawn = {"zero": 0.0, "hundred": 100.0, "dot": value, "low": ends[0], "high": ends[1]}
    return {name: place(number, domain) for name, number in drawn.items()}


def heat(value: Any, domain: Domain) -> int | None:
    """How strongly a cell is tinted, 0 to 8; None without a value."""
    number = finite(value)
    if number is None:
        return None
    share = (number - domain[0]) / ((domain[1] - domain[0]) or 1)
    return max(0, min(HEAT_STEPS - 1, int(share * HEAT_STEPS)))


def histogram_picture(shares: Any, width: int = 480, height: int = 110) -> dict[str, Any] | None:
    """The bars of a histogram over frequency points; None where there is none.

    Args:
        shares: one number of 0 or more per point, in any unit.
        width, height: in pixels, of the whole picture.
    """
    numbers = [finite(share) for share in shares] if isinstance(shares, list | tuple) else []
    known = [max(number, 0.0) for number in numbers if number is not None]
    if len(known) != len(numbers) or not known or not sum(known):
        return None
    total, top, step = sum(known), max(known), width / len(known)
    bars = [
        {
            "x": round(index * step + 1, 1),
            "y": round(height - number / top * height, 1),
            "width": round(step - 2, 1),
            "height": round(number / top * height, 1),
            "share": number / total,
        }
        for index, number in enumerate(known)
    ]
    return {"bars": bars, "width": width, "height": height, "top": top / total}
