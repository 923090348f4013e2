"""Readings of the paper: each point that it leaves open, settled one way or another.

A reading is the preset ``paper`` with some points settled otherwise. What each point is about, and where the
paper speaks of it, stands in ``docs/open_points.md``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.paper.conditions import HIDDEN, POWER_FACTORS

LETTER = "letter"
REMEMBERED = {"match": 10, "for-ever": 40}  # rounds


@dataclass(frozen=True)
class Setting:
    """One way to settle a point.

    Attributes:
        about: what it says.
        changes: fields of the scenario ``paper`` that are other ones.
    """

    about: str
    changes: Mapping[str, Any] = field(default_factory=dict)


# By point; the first setting of each is that of the preset ``paper``.
POINTS: Mapping[str, Mapping[str, Setting]] = MappingProxyType(
    {
        "interference": {
            "twice": Setting("Eq. 2 and 3 to the letter: interference counts twice"),
            "once": Setting("the usual ratio of signal to interference and noise", {"snr_model": "sinr"}),
        },
        "k": {
            "level": Setting("k of Table 1 multiplies the level in dBm, as printed"),
            "power": Setting(
                "k multiplies the power in mW: 20 dBm + 10 lg k", {"jamming_coefficients": POWER_FACTORS}
            ),
        },
        "footprints": {
            "narrow": Setting("half widths of 2.5, 10, 25 and 2.5 MHz"),
            "wide": Setting("twice as wide", {"footprint_half_widths_mhz": (5.0, 20.0, 50.0, 5.0)}),
        },
        "hops": {
            "gated": Setting("the ally learns when to hop (Eq. 5)"),
            "always": Setting(
                "the knowledge base hops in every step (Algorithm 1, line 6)", {"hopping": "always"}
            ),
        },
        "hop-cost": {
            "100": Setting("H = 100"),
            "40": Setting("H = 40", {"hop_cost": 40.0}),
            "0": Setting("H = 0", {"hop_cost": 0.0}),
        },
        "speed": {
            "learned": Setting("the ally learns how fast it flies, 5 to 10 m/s"),
            "fixed": Setting("it always flies at 10 m/s", {"ally_speed_m_s": (10.0, 10.0)}),
        },
        "checks": {
            "visible": Setting("every 5 s, and both sides know"),
            "hidden": Setting("every 4 to 6 s", HIDDEN),
        },
        "receiver": {
            "link": Setting("a check hears where the ally's SNR is above M"),
            "own": Setting("it hears by the opponent's own receiver", {"detection": "emission"}),
        },
        "memory": {
            "match": Setting("the planner remembers the ten rounds of a match"),
            "for-ever": Setting("the planner forgets nothing; the ally's curve never changes"),
        },
    }
)


@dataclass(frozen=True)
class Reading:
    """One setting of each point, in the order of :data:`POINTS`."""

    settings: tuple[str, ...]

    @property
    def name(self) -> str:
        """Where it departs from the preset ``paper``: ``interference=once,k=power``; ``letter``: nowhere."""
        told = [
            f"{point}={setting}"
            for (point, known), setting in zip(POINTS.items(), self.settings, strict=True)
            if setting != next(iter(known))
        ]
        return ",".join(told) or LETTER

    @property
    def parts(self) -> list[Setting]:
        """What it says of each point."""
        return [known[name] for known, name in zip(POINTS.values(), self.settings, strict=True)]

    @property
    def items(self) -> list[tuple[str, str]]:
        """Its points and their settings."""
        return list(zip(POINTS, self.settings, strict=True))

    def of(self, point: str) -> str:
        """Its setting of a point."""
        return self.settings[list(POINTS).index(point)]

    def but(self, **settings: str) -> Reading:
        """The same reading with other settings of some points, whose hyphens are written ``_``."""
        chosen = {point: settings.get(point.replace("-", "_")) for point in POINTS}
        return Reading(tuple(new or old for new, old in zip(chosen.values(), self.settings, strict=True)))

    @property
    def rounds(self) -> int:
        """How many rounds of a match the planner remembers."""
        return REMEMBERED[self.of("memory")]

    @property
    def changes(self) -> dict[str, Any]:
        """The fields of the scenario ``paper`` that are other ones, besides ``rounds_per_match``."""
        return {name: value for part in self.parts for name, value in part.changes.items()}

    def scenario(self) -> Scenario:
        """What is played, in matches of as many rounds as the planner remembers."""
        return as_scenario("paper", rounds_per_match=self.rounds, **self.changes)


def as_reading(text: str) -> Reading:
    """The reading of a name, ``letter`` or ``interference=once,k=power``.

    Raises:
        UserError: an unknown point or setting, or a point that is settled twice.
    """
    chosen: dict[str, str] = {}
    for part in text.split(",") if text != LETTER else ():
        point, _, setting = part.strip().partition("=")
        if point not in POINTS:
            raise UserError(f"reading {text!r}: unknown point {point!r}{nearest(point, POINTS)}")
        if setting not in POINTS[point]:
            known = ", ".join(POINTS[point])
            raise UserError(f"reading {text!r}: {point}: expected one of {known}, got {setting!r}")
        if chosen.setdefault(point, setting) != setting:
            raise UserError(f"reading {text!r}: {point} is settled twice, {chosen[point]} and {setting}")
    return Reading(tuple(chosen.get(point, next(iter(known))) for point, known in POINTS.items()))


def every_reading(points: Iterable[str] = POINTS) -> Iterator[Reading]:
    """All readings that differ in these points alone, the letter first.

    Raises:
        UserError: an unknown point.
    """
    wanted = set(points)
    if unknown := sorted(wanted - set(POINTS)):
        raise UserError(f"unknown point {unknown[0]!r}{nearest(unknown[0], POINTS)}")
    for settings in product(
        *(known if point in wanted else list(known)[:1] for point, known in POINTS.items())
    ):
        yield Reading(settings)
