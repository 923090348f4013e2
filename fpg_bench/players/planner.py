"""Path planners: between two rounds of a match a planner decides where the opponent flies next.

The contract, the planners without any information (tier ``none``), and the names of all: products offer more
of them (``planner``).
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import UnionType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.imports import has_any, import_object, ready, reason
from fpg_bench.common.products import load, offered
from fpg_bench.game.flight import place_on_patrol
from fpg_bench.game.names import PATHS, PATROLS
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario

TIERS = ("none", "history", "ally")
Array = NDArray[np.float64]

_KINDS: dict[str, type | UnionType] = {
    "source": str, "status": str, "tokens": int | None, "seconds": float | int | None, "useless": str | None
}  # fmt: skip


@dataclass(frozen=True)
class Limits:
    """Limits of a plan.

    Attributes:
        box_m: the box's sides in m.
        speed_m_s: the opponent's greatest speed in m/s.
        round_s: length of a round in s, T.
        waypoints: number of waypoints, n.
    """

    box_m: tuple[float, ...]
    speed_m_s: float
    round_s: int
    waypoints: int

    @classmethod
    def of(cls, scenario: Scenario) -> Limits:
        """Return the limits of a scenario."""
        s = scenario
        return cls(s.box_m, s.opponent_speed_m_s, s.steps_per_round, s.waypoints)

    def due_s(self) -> np.ndarray:
        """Return the whole second ``(n,)`` at which each waypoint is due, (i + 1) T / n rounded up."""
        return np.ceil((np.arange(self.waypoints) + 1) * self.round_s / self.waypoints)

    def middles_s(self) -> np.ndarray:
        """Return the whole second ``(n,)`` in the middle of each part: that of its position in a history."""
        edges = -(-np.arange(self.waypoints + 1) * self.round_s // self.waypoints)
        return np.asarray((edges[:-1] + edges[1:]) // 2 + 1)


@dataclass(frozen=True)
class Plan:
    """A path for the next round, with its origin.

    Attributes:
        waypoints: ``(n, 3)`` in m, point i due at (i + 1) T / n.
        source: the planner that it came from.
        status: ``ok``, or what went wrong on the way (see the LLM planner).
        tokens: tokens that a language model read and wrote for it; None for other planners.
        seconds: planning time; None: not measured.
        useless: the sign that a language model's valid path is useless (see
            :func:`fpg_bench.products.language_models.answers.uselessness`); empty: no such sign; None: not
            checked.
        problem: the reason that a language model gave no valid path and another one is flown; None if it did.
    """

    waypoints: np.ndarray
    source: str
    status: str = "ok"
    tokens: int | None = None
    seconds: float | None = None
    useless: str | None = None
    problem: str | None = None


@dataclass(frozen=True)
class Request:
    """A planner's input for one game's next round.

    Attributes:
        history: ``(rounds, n, 4)``: for each complete round of the match so far and each n-th part of it,
            the opponent's position in m in the middle of that part, and its mean reward over it.
        current_position: ``(3,)`` in m, the opponent's position at the start of the round.
        limits: limits of the plan.
        rng: the game's own random generator for this plan.
        game: the game's index in its batch.
        seed, match, round: those of the game.
        ally_path: ``(T + 1, 3)`` in m, the ally's position after each second if it flies at full speed;
            for planners of the tier ``ally`` alone, None for all others.
        ally_flown: the same of the match's previous round, as the ally flew it; None in a match's first.
    """

    history: np.ndarray
    current_position: np.ndarray
    limits: Limits
    rng: np.random.Generator
    game: int = 0
    seed: int = 0
    match: int = 0
    round: int = 0
    ally_path: np.ndarray | None = None
    ally_flown: np.ndarray | None = None


class Planner(Protocol):
    """Decides where the opponent flies in the next round.

    ``tier`` states the planner's information: ``none``, ``history`` (own past positions and rewards) or
    ``ally`` (the ally's path: an upper bound). Comparisons of planners of different tiers must state them. A
    planner that asks a language model also has ``asks_language_model = True``.

    A planner that takes all waiting games at once, or more than the arguments of ``plan``, has
    ``plan_batch`` as well or instead: see :class:`BatchPlanner`.
    """

    name: str
    tier: str

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """Return the next round's path; the arguments are those of :class:`Request`."""
        ...


@runtime_checkable
class AsksLanguageModel(Protocol):
    """A planner that says whether it asks a language model, which takes time and money."""

    asks_language_model: bool


def asks_language_model(planner: object) -> bool:
    """Return whether a planner, given by its name or as an object, asks a language model."""
    if isinstance(planner, str):
        planner = load("planner", planner) if planner in offered("planner") else None
    return isinstance(planner, AsksLanguageModel) and planner.asks_language_model


@runtime_checkable
class CountsPlans(Protocol):
    """A planner that counts the rounds flown on a plan of each status."""

    flown: Counter[str]


class BatchPlanner(ABC):
    """Base class of planners that are asked for all waiting games at once."""

    name: str
    tier: str

    @abstractmethod
    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return one plan for each request; none may depend on the others."""

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """Return the plan for one game."""
        return self.plan_batch([Request(history, current_position, limits, rng)])[0]


def plan_all(planner: Any, requests: Sequence[Request]) -> list[Plan]:
    """Ask a planner for the plans of some games, by ``plan_batch`` where it has it.

    Returns:
        One plan a request, its waypoints as an array of float, with its planning time (that of a batch is
        divided evenly).

    Raises:
        UserError: the planner fails, or returns something else than plans.
    """
    start = time.perf_counter()
    try:
        if callable(getattr(planner, "plan_batch", None)):
            plans = list(planner.plan_batch(requests))
        else:
            plans = [planner.plan(r.history, r.current_position, r.limits, r.rng) for r in requests]
    except (UserError, OSError):
        raise
    except Exception as error:  # a planner is arbitrary user code
        raise UserError(f"planner {planner_name(planner)}: its plan failed: {reason(error)}") from error
    if len(plans) != len(requests):
        raise UserError(f"planner {planner_name(planner)}: {len(plans)} plans for {len(requests)} games")
    each = (time.perf_counter() - start) / max(len(plans), 1)
    plans = [_checked(plan, f"planner {planner_name(planner)}") for plan in plans]
    return [plan if plan.seconds is not None else replace(plan, seconds=each) for plan in plans]


def planner_name(planner: object) -> str:
    """Return a planner's name for messages: its ``name`` or ``__name__``, else its class."""
    names = (getattr(planner, attribute, None) for attribute in ("name", "__name__"))
    return next((name for name in names if isinstance(name, str) and name), type(planner).__name__)


def check_described(planner: object) -> None:
    """Raise UserError where a planner lacks a valid ``name`` or ``tier``."""
    name, tier = getattr(planner, "name", None), getattr(planner, "tier", None)
    if not (isinstance(name, str) and name):
        raise UserError(f"planner {planner_name(planner)}: its name is {name!r}; set it to a word")
    if tier not in TIERS:
        raise UserError(f"planner {name}: its tier is {tier!r}; set it to one of {', '.join(TIERS)}")


def _checked(plan: object, where: str) -> Plan:
    """Return a plan with checked types and its waypoints as an array; their values are not checked."""
    if not isinstance(plan, Plan):
        given = type(plan).__name__
        raise UserError(f"{where}: plan must give a fpg_bench.players.planner.Plan, got {given}")
    for name, kind in _KINDS.items():
        if not isinstance(value := getattr(plan, name), kind):
            expected = getattr(kind, "__name__", kind)
            raise UserError(f"{where}: its plan's {name} is {value!r}; expected {expected}")
    try:
        return replace(plan, waypoints=np.asarray(plan.waypoints, float))
    except (TypeError, ValueError) as error:
        raise UserError(f"{where}: its waypoints are not an array of numbers: {reason(error)}") from error


class Patrol(BatchPlanner):
    """A circle, triangle or rectangle, flown as the patrol of the same name would be."""

    tier = "none"

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self._rules = rules_record(scenario)

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the patrol's places at the times at which the waypoints are due."""
        return [Plan(self._places(request.limits), self.name) for request in requests]

    def _places(self, limits: Limits) -> np.ndarray:
        waypoints = np.zeros((limits.waypoints, 3))
        for waypoint, due in zip(waypoints, limits.due_s(), strict=True):
            place_on_patrol(waypoint, PATHS.index(self.name), limits.speed_m_s * due, self._rules[0])
        return np.clip(waypoints, 0, limits.box_m)


class Hold(BatchPlanner):
    """Stays at its current position."""

    name, tier = "hold", "none"

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the current position as every waypoint."""
        return [Plan(np.tile(r.current_position, (r.limits.waypoints, 1)), self.name) for r in requests]


class Random(BatchPlanner):
    """Flies to uniform points of the box."""

    name, tier = "random", "none"

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Draw new waypoints for every round."""
        return [Plan(r.rng.uniform(0, r.limits.box_m, (r.limits.waypoints, 3)), self.name) for r in requests]


circle, triangle, rectangle = (partial(Patrol, name) for name in PATROLS)
PLANNERS = tuple(offered("planner"))
_METHODS = ("plan", "plan_batch")


def as_planner(spec: object, scenario: Scenario) -> Planner:
    """Return the planner that ``spec`` names, makes, or is.

    >>> from fpg_bench.game.scenario import preset
    >>> as_planner("circle", preset("standard")).name
    'circle'

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
        if spec not in PLANNERS:
            raise UserError(f"unknown planner {spec!r}{nearest(spec, PLANNERS)}")
        return ready(load("planner", spec), f"planner {spec!r}", _METHODS, scenario)
    if not (callable(spec) or has_any(spec, _METHODS)):
        raise UserError(f"planner: expected a name or an object with plan, got {spec!r}")
    return ready(spec, f"planner {planner_name(spec)}", _METHODS, scenario)
