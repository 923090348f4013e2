"""Registry of planners: a name, an import path or an object, resolved to a planner."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.imports import has_any, import_object, ready
from fpg_bench.common.products import load, offered
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.interceptor import Interceptor
from fpg_bench.planning.patterns import PATTERNS
from fpg_bench.planning.planner import Planner, check_described, planner_name
from fpg_bench.planning.pursuit import Chaser, Optimised
from fpg_bench.planning.search import CMAES, HillClimb

# Planners that ask a language model, and what each control withholds from the model
LLM_CONTROLS = MappingProxyType(
    {"llm": "none", "llm-shuffled-rewards": "shuffled-rewards", "llm-no-history": "no-history"}
)
_METHODS = ("plan", "plan_batch")


def _language_model(name: str, scenario: Scenario) -> Any:
    return load("planner", name)(scenario, control=LLM_CONTROLS[name])


_MAKERS: dict[str, Callable[[Scenario], Any]] = {
    **PATTERNS,
    "hill-climb": lambda scenario: HillClimb(),
    "cma-es": lambda scenario: CMAES(),
    "interceptor": Interceptor,
    **{name: partial(_language_model, name) for name in offered("planner")},
    "pursuit": lambda scenario: Chaser("pursuit"),
    "lead-pursuit": lambda scenario: Chaser("lead-pursuit"),
    "optimised": Optimised,
    "optimised-flown": partial(Optimised, flown=True),
}
PLANNERS = tuple(_MAKERS)


def as_planner(spec: object, scenario: Scenario) -> Planner:
    """Return the planner that ``spec`` names, makes, or is.

    >>> from fpg_bench.game.scenario import preset
    >>> as_planner("interceptor", preset("standard")).name
    'interceptor'

    Args:
        spec: one of ``PLANNERS``; ``package.module:object`` (a planner, or a class or function that makes
            one, given the scenario if it takes an argument); such a class or function; or an object with
            ``plan`` or ``plan_batch``.
        scenario: what is played.

    Raises:
        UserError: no such planner, one that cannot be made, has no ``plan`` or ``plan_batch``, or no valid
            name and tier; or a language model and no endpoint configured.
    """
    planner: Planner = resolve(spec, scenario)
    check_described(planner)
    return planner


def resolve(spec: object, scenario: Scenario) -> Any:
    """Return the planner of a spec as :func:`as_planner` does, without checking its name and tier."""
    if isinstance(spec, str) and ":" in spec:
        return import_object(spec, "planner", _METHODS, scenario)
    if isinstance(spec, str):
        if spec not in _MAKERS:
            raise UserError(f"unknown planner {spec!r}{nearest(spec, PLANNERS)}")
        return _MAKERS[spec](scenario)
    if not (callable(spec) or has_any(spec, _METHODS)):
        raise UserError(f"planner: expected a name or an object with plan, got {spec!r}")
    return ready(spec, f"planner {planner_name(spec)}", _METHODS, scenario)
