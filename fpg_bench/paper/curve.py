"""Specification curves: each claim under every reading, sorted, and below which settings each reading has.

Simonsohn, Simmons and Nelson, "Specification curve analysis" (Nature Human Behaviour, 2020).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.common.rows import Row
from fpg_bench.paper.claims import LEVEL
from fpg_bench.paper.readings import POINTS, Reading, as_reading
from fpg_bench.rendering.canvas import blank_figure

HELD, OPPOSITE, OPEN = "#0b5fa5", "#d95f02", "#777777"


@dataclass(frozen=True)
class Spot:
    """A claim under a reading: its weakest part, which decides (intersection-union).

    Attributes:
        reading: which.
        weakest: that part as it stands in a screen's row; see :class:`fpg_bench.paper.screen.Part`.
        against: how many parts have an interval below zero.
    """

    reading: Reading
    weakest: Mapping[str, Any]
    against: int

    @property
    def size(self) -> float:
        """The mean in half widths of its interval: claims have different units, readings different scales."""
        part = self.weakest
        return part["mean"] / max((part["high"] - part["low"]) / 2, 1e-9)

    @property
    def holds(self) -> bool:
        """Whether all parts of the claim do: the weakest one is positive, by a one-sided p below 0.025."""
        return _not_positive(self.weakest) < LEVEL / 2


def claims_of(rows: Sequence[Row]) -> list[str]:
    """The claims that rows speak of, in order."""
    return sorted({part["claim"] for row in rows for part in row["parts"]})


def spots(rows: Sequence[Row], claim: str) -> list[Spot]:
    """A claim under the readings of a screen's rows, those first under which it is furthest from holding."""
    found = [_spot(row, claim) for row in rows]
    return sorted(found, key=lambda spot: (spot.size, spot.reading.name))


def _spot(row: Row, claim: str) -> Spot:
    parts = [part for part in row["parts"] if part["claim"] == claim]
    weakest = max(parts, key=_not_positive)
    return Spot(as_reading(row["reading"]), weakest, sum(part["high"] < 0 for part in parts))


def _not_positive(part: Mapping[str, Any]) -> float:
    """One-sided p."""
    half = part["p"] / 2
    return half if part["mean"] > 0 else 1 - half


def shares(found: Sequence[Spot]) -> dict[tuple[str, str], float]:
    """By point and setting, the share of the readings with it under which the claim holds."""
    held: dict[tuple[str, str], list[bool]] = {}
    for spot in found:
        for point, setting in zip(POINTS, spot.reading.settings, strict=True):
            held.setdefault((point, setting), []).append(spot.holds)
    return {key: sum(values) / len(values) for key, values in held.items()}


def draw_curve(rows: Sequence[Row]) -> Any:
    """A column for each claim: its weakest part with a 95 % interval, and the settings as dots below.

    Args:
        rows: of :func:`fpg_bench.paper.screen.screen_all`.

    Returns:
        A matplotlib ``Figure``.
    """
    settings = [(point, setting) for point, known in POINTS.items() for setting in known]
    claims = claims_of(rows)
    figure = blank_figure(2.6 * len(claims) + 1.4, 8)
    above, below = figure.subplots(2, len(claims), sharex="col", sharey="row", height_ratios=(2, 3))
    for column, claim in enumerate(claims):
        found = spots(rows, claim)
        _draw_effects(above[column], found, claim)
        _draw_settings(below[column], found, settings)
    above[0].set_ylabel("weakest part, in its 95 % half widths")
    below[0].set_yticks(
        range(len(settings)), [f"{point}: {setting}" for point, setting in settings], fontsize=8
    )
    below[0].invert_yaxis()
    return figure


def _colour(spot: Spot) -> str:
    if spot.holds:
        return HELD
    return OPPOSITE if spot.against else OPEN


def _draw_effects(axes: Any, found: Sequence[Spot], claim: str) -> None:
    held, colours = sum(spot.holds for spot in found), [_colour(spot) for spot in found]
    axes.scatter(
        range(len(found)), [spot.size for spot in found], s=4, c=colours, linewidths=0, rasterized=True
    )
    axes.axhline(0, color="black", lw=0.8)
    axes.axhspan(-1, 1, color="#000000", alpha=0.08, lw=0)
    axes.set_yscale("symlog", linthresh=1)
    axes.set_title(f"{claim}:\nholds under {held} of {len(found)}", fontsize=9)


def _draw_settings(axes: Any, found: Sequence[Spot], settings: Sequence[tuple[str, str]]) -> None:
    rank = {setting: line for line, setting in enumerate(settings)}
    dots = [
        (place, rank[each], _colour(spot))
        for place, spot in enumerate(found)
        for each in zip(POINTS, spot.reading.settings, strict=True)
    ]
    across, down, colours = zip(*dots, strict=True)
    axes.scatter(across, down, s=28, c=colours, marker="|", linewidths=0.25, rasterized=True)
    axes.set_xlabel("readings, sorted")
    axes.grid(axis="y", alpha=0.2)
