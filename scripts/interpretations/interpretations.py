"""Interpretations of the paper: every point that it leaves open, resolved in one way or another.

An interpretation is the preset ``paper`` with some points resolved differently. ``docs/open_points.md``
explains each point and where the paper mentions it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.paper.conditions import HIDDEN, POWER_FACTORS

AS_PRINTED = "as-printed"
REMEMBERED = {"match": 10, "for-ever": 40}  # rounds


@dataclass(frozen=True)
class Setting:
    """One way to resolve a point.

    Attributes:
        about: description.
        changes: changed fields of the scenario ``paper``.
    """

    about: str
    changes: Mapping[str, Any] = field(default_factory=dict)


# By point; the first setting of each is that of the preset ``paper``.
POINTS: Mapping[str, Mapping[str, Setting]] = MappingProxyType(
    {
        "interference": {
            "twice": Setting("Eq. 2 and 3 as printed: interference counts twice"),
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
class Interpretation:
    """One setting of each point, in the order of :data:`POINTS`."""

    settings: tuple[str, ...]

    @property
    def name(self) -> str:
        """Differences from the preset ``paper``: ``interference=once,k=power``; ``as-printed`` if none."""
        differences = [
            f"{point}={setting}"
            for (point, known), setting in zip(POINTS.items(), self.settings, strict=True)
            if setting != next(iter(known))
        ]
        return ",".join(differences) or AS_PRINTED

    @property
    def parts(self) -> list[Setting]:
        """The setting of each point."""
        return [known[name] for known, name in zip(POINTS.values(), self.settings, strict=True)]

    @property
    def items(self) -> list[tuple[str, str]]:
        """Pairs of point and setting name."""
        return list(zip(POINTS, self.settings, strict=True))

    def setting(self, point: str) -> str:
        """Return the setting of a point."""
        return self.settings[list(POINTS).index(point)]

    def replace(self, **settings: str) -> Interpretation:
        """Return a copy with other settings of some points; hyphens of names are written ``_``."""
        chosen = {point: settings.get(point.replace("-", "_")) for point in POINTS}
        return Interpretation(
            tuple(new or old for new, old in zip(chosen.values(), self.settings, strict=True))
        )

    @property
    def rounds(self) -> int:
        """Number of rounds that the planner remembers."""
        return REMEMBERED[self.setting("memory")]

    @property
    def changes(self) -> dict[str, Any]:
        """Changed fields of the scenario ``paper``, except ``rounds_per_match``."""
        return {name: value for part in self.parts for name, value in part.changes.items()}

    def scenario(self) -> Scenario:
        """Return the scenario, in matches of as many rounds as the planner remembers."""
        return as_scenario("paper", rounds_per_match=self.rounds, **self.changes)


def parse_interpretation(text: str) -> Interpretation:
    """Parse a name, ``as-printed`` or ``interference=once,k=power``.

    Raises:
        UserError: an unknown point or setting, or a point that is resolved twice.
    """
    chosen: dict[str, str] = {}
    for part in text.split(",") if text != AS_PRINTED else ():
        point, _, setting = part.strip().partition("=")
        if point not in POINTS:
            raise UserError(f"interpretation {text!r}: unknown point {point!r}{nearest(point, POINTS)}")
        if setting not in POINTS[point]:
            known = ", ".join(POINTS[point])
            raise UserError(f"interpretation {text!r}: {point}: expected one of {known}, got {setting!r}")
        if chosen.setdefault(point, setting) != setting:
            raise UserError(
                f"interpretation {text!r}: {point} is resolved twice, {chosen[point]} and {setting}"
            )
    return Interpretation(tuple(chosen.get(point, next(iter(known))) for point, known in POINTS.items()))


def all_interpretations(points: Iterable[str] = POINTS) -> Iterator[Interpretation]:
    """Yield all interpretations that differ in these points only, ``as-printed`` first.

    Raises:
        UserError: an unknown point.
    """
    wanted = set(points)
    if unknown := sorted(wanted - set(POINTS)):
        raise UserError(f"unknown point {unknown[0]!r}{nearest(unknown[0], POINTS)}")
    for settings in product(
        *(known if point in wanted else list(known)[:1] for point, known in POINTS.items())
    ):
        yield Interpretation(settings)
