"""Interpretations of the paper: every point that it leaves open, resolved in one way or another.

An interpretation is the preset ``paper`` with some points resolved differently. ``docs/open_points.md``
explains each point and where the paper mentions it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.paper.conditions import HIDDEN, POWER_FACTORS

AS_PRINTED = "as-printed"
REMEMBERED = {"match": 10, "for-ever": 40}  # rounds


class Setting(NamedTuple):
    """One way to resolve a point: its description, and the changed fields of the scenario ``paper``."""

    about: str
    changes: Mapping[str, Any] = {}


# By point; the first setting of each is that of the preset ``paper``.
POINTS: Mapping[str, Mapping[str, Setting]] = {
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


@dataclass(frozen=True)
class Interpretation:
    """One setting of each point, in the order of :data:`POINTS`."""

    settings: tuple[str, ...]

    @property
    def name(self) -> str:
        """Differences from the preset ``paper``: ``interference=once,k=power``; ``as-printed`` if none."""
        as_printed = next(all_interpretations())
        return ",".join(map("=".join, self.differences(as_printed))) or AS_PRINTED

    @property
    def items(self) -> list[tuple[str, str]]:
        """Pairs of point and setting name."""
        return list(zip(POINTS, self.settings, strict=True))

    def differences(self, other: Interpretation) -> list[tuple[str, str]]:
        """Return the points that another interpretation resolves differently, with the settings here."""
        return [item for item in self.items if item not in other.items]

    def setting(self, point: str) -> str:
        """Return the setting of a point."""
        return dict(self.items)[point]

    def replace(self, settings: Mapping[str, str]) -> Interpretation:
        """Return a copy with other settings of some points."""
        if unknown := [pair for pair in settings.items() if pair[1] not in POINTS.get(pair[0], ())]:
            raise ValueError(f"unknown point or setting: {'='.join(unknown[0])}")
        return Interpretation(tuple((dict(self.items) | dict(settings)).values()))

    @property
    def rounds(self) -> int:
        """Number of rounds that the planner remembers."""
        return REMEMBERED[self.setting("memory")]

    @property
    def changes(self) -> dict[str, Any]:
        """Changed fields of the scenario ``paper``, except ``rounds_per_match``."""
        changes = [POINTS[point][setting].changes for point, setting in self.items]
        return {name: value for each in changes for name, value in each.items()}

    def scenario(self) -> Scenario:
        """Return the scenario, in matches of as many rounds as the planner remembers."""
        return as_scenario("paper", rounds_per_match=self.rounds, **self.changes)


def all_interpretations(points: Collection[str] = tuple(POINTS)) -> Iterator[Interpretation]:
    """Yield all interpretations that differ in these points only, ``as-printed`` first."""
    settings = (known if point in points else [next(iter(known))] for point, known in POINTS.items())
    return map(Interpretation, product(*settings))


def parse_interpretation(name: str) -> Interpretation:
    """Parse a name, ``as-printed`` or ``interference=once,k=power``; an unknown part is a ValueError."""
    as_printed = next(all_interpretations())
    differences = [] if name == AS_PRINTED else [part.split("=") for part in name.split(",")]
    return as_printed.replace(dict(differences))
