"""Conditions of the paper's experiments: their differences from its game."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, as_scenario

ROUNDS_PER_MATCH = 10
BASE = "planned"
FIXED_PATHS = ("triangle", "circle", "rectangle")
PLANNERS = ("hill-climb", "cma-es", "optimised")
NO_PLANNER, NO_KNOWLEDGE = "no-planner", "no-knowledge"
LLM, LONG = "llm", "planned-long"
LONG_IN = "paper"  # preset in which one run of ten budgets serves as a check
SHORT_SEEDS = 5  # of conditions that no claim rests on
Changes = Mapping[str, object]  # of a scenario's fields


@dataclass(frozen=True)
class Condition:
    """An experimental condition.

    Attributes:
        name: name in rows and figures.
        planner: plans the opponent's path; None: nobody does.
        path: its path instead.
        changes: changed fields of the scenario.
        tested: true if a claim rests on it; it then needs all seeds.
        budgets: length of its training, in budgets of the others.
        swaps: paths on which the trained pair is evaluated again, with nothing else changed.
    """

    name: str
    planner: str | None = "interceptor"
    path: str | None = None
    changes: Changes = field(default_factory=dict)
    tested: bool = False
    budgets: int = 1
    swaps: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of its runs: its own, and one per swap."""
        return self.name, *(swapped(self.name, path) for path in self.swaps)

    def scenario(self, preset: str) -> Scenario:
        """Return the preset with the changes of this condition, in matches of at least ten rounds."""
        rounds = max(ROUNDS_PER_MATCH, as_scenario(preset).rounds_per_match)
        return as_scenario(preset, **{"rounds_per_match": rounds, **self.changes})


_MAIN = (
    Condition(BASE, tested=True, swaps=FIXED_PATHS),
    *(Condition(path, None, path, tested=True) for path in FIXED_PATHS),
    *(Condition(name, name) for name in PLANNERS),
    *(Condition(kind, changes={"jamming_types": (kind,)}, tested=True) for kind in JAMMING_TYPES),
    Condition(NO_PLANNER, None, "learned", tested=True),
    Condition(NO_KNOWLEDGE, changes={"knowledge": "none"}, tested=True),
    Condition(LONG, budgets=10),
)
# k as a factor of the power in mW, not of its level in dBm: 20 dBm + 10 lg k, as a multiple of 20 dBm.
POWER_FACTORS = (1.088046, 1.03959, 0.801030, 0.951545)
_TWICE = {"snr_model": "paper"}  # interference counts twice
_OTHERWISE: dict[str, dict[str, Changes]] = {
    "paper": {
        "hidden-checks": {"first_check_s": (1, 5), "check_interval_s": (4, 6), "check_scale_s": 6.0},
        "interference-once": {"snr_model": "sinr"},
        "own-receiver": {"detection": "emission"},
    },
    "standard": {
        "visible-checks": {"first_check_s": (5, 5), "check_interval_s": (5, 5)},
        "interference-twice": _TWICE,
        "blinded": {"detection": "link"},
    },
    "figures": {  # its differences from the paper as printed, reverted one by one
        "interference-twice": _TWICE,
        "gated-hops": {"hopping": "gated"},
        "match-memory": {"rounds_per_match": ROUNDS_PER_MATCH},
    },
}
_HOP_COSTS = {"paper": (0, 200), "standard": (0, 200), "figures": (100,)}  # beside the preset's own


def sensitivity(preset: str) -> tuple[Condition, ...]:
    """Return the conditions that resolve one open point of the paper differently from the scenario.

    The page on open points (``reference/open-points``) explains those of ``paper`` and ``standard``.
    """
    others: dict[str, Changes] = {
        "k-power": {"jamming_coefficients": POWER_FACTORS},
        **_OTHERWISE[preset],
        **{f"hop-cost-{cost}": {"hop_cost": cost} for cost in _HOP_COSTS[preset]},
    }
    return tuple(Condition(name, changes=changes) for name, changes in others.items())


ALL = "all"
# Conditions of each figure.
TARGETS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "fig3": (BASE, *FIXED_PATHS, *PLANNERS),
        "fig4": (BASE,),
        "fig5": (BASE,),
        "fig6": (BASE, *JAMMING_TYPES),
        "fig7": (BASE, NO_PLANNER, NO_KNOWLEDGE),
    }
)


def swapped(condition: str, path: str) -> str:
    """Return the name of a condition's trained pairs on another path."""
    return f"{condition}@{path}"


def conditions_of(target: str, preset: str, full: bool) -> list[Condition]:
    """Return the conditions of a figure, or of all figures.

    Args:
        target: ``fig3`` to ``fig7``, or ``all``.
        preset: ``paper``, ``standard`` or ``figures``.
        full: include in ``all`` the sensitivity study and, for ``paper``, the long run.

    Raises:
        UserError: an unknown target or preset.
    """
    one_of(preset, "scenario", _OTHERWISE)
    if target == ALL:
        conditions = [c for c in _MAIN if c.name != LONG or (full and preset == LONG_IN)]
        return [*conditions, *(sensitivity(preset) if full else ())]
    if target not in TARGETS:
        raise UserError(f"unknown target {target!r}{nearest(target, [*TARGETS, ALL])}")
    return [c for c in _MAIN if c.name in TARGETS[target]]
