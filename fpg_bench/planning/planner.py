"""What a path planner is: between two rounds of a match it decides where the opponent flies next."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.imports import reason

TIERS = ("none", "history", "ally")

_KINDS: dict[str, Any] = {"source": str, "status": str, "tokens": int | None, "seconds": float | int | None}
_KINDS["useless"] = str | None


@dataclass(frozen=True)
class Limits:
    """What a plan must keep to: box (m), opponent's speed (m/s), length of a round (s), number of points."""

    box_m: tuple[float, ...]
    speed_m_s: float
    round_s: int
    waypoints: int

    @classmethod
    def of(cls, scenario: Scenario) -> Limits:
        """The limits of a scenario."""
        s = scenario
        return cls(s.box_m, s.opponent_speed_m_s, s.steps_per_round, s.waypoints)

    def due_s(self) -> np.ndarray:
        """``(waypoints,)``: the whole second at which each point is due, (i + 1) T / n rounded up."""
        return np.ceil((np.arange(self.waypoints) + 1) * self.round_s / self.waypoints)


@dataclass(frozen=True)
class Plan:
    """Where to fly, and how it came about.

    Attributes:
        waypoints: ``(n, 3)`` in m, point i due at (i + 1) T / n.
        source: the planner that it came from.
        status: ``ok``, or what went wrong on the way (see the LLM planner).
        tokens: tokens that a language model read and wrote for it; None for other planners.
        seconds: how long planning took; None: not measured.
        useless: why a valid path of a language model is of no use (see
            :mod:`fpg_bench.planning.llm.useless`); empty: no sign of it; None: nobody has looked.
    """

    waypoints: np.ndarray
    source: str
    status: str = "ok"
    tokens: int | None = None
    seconds: float | None = None
    useless: str | None = None


@dataclass(frozen=True)
class Request:
    """What a planner is asked about one game's next round.

    Attributes:
        history: ``(rounds, n, 4)``: for each whole round of the match that was played and each n-th part
            of it, the opponent's position in m in the middle of that part, and its mean reward over it.
        current_position: ``(3,)`` in m, where the round starts.
        limits: what the plan must keep to.
        rng: the game's own chance for this plan.
        game: the game's index in its batch.
        seed, match, round: which round of which match it is.
        ally_path: ``(T + 1, 3)`` in m, where the ally is after each second if it flies at full speed;
            for planners of the tier ``ally`` alone, None for all others.
        ally_flown: the same of the match's round before, as the ally flew it; None in a match's first.
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

    ``tier`` says what the planner knows: ``none``, ``history`` (own past positions and rewards) or
    ``ally`` (the ally's path: an upper bound). Planners of different tiers are never compared without
    saying so. One that asks a language model says so, too: its ``asks_language_model`` is True.

    A planner that wants all waiting games at once, or more than ``plan`` is told, has ``plan_batch``, too
    or alone: see :class:`BatchPlanner`.
    """

    name: str
    tier: str

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The next round's path; the arguments are those of :class:`Request`."""
        ...


class BatchPlanner(ABC):
    """A planner that is asked for all waiting games at once."""

    name: str
    tier: str

    @abstractmethod
    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """One plan for each request; none may depend on the others."""

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The plan for one game, of which no more is known than this."""
        return self.plan_batch([Request(history, current_position, limits, rng)])[0]


def plan_all(planner: Any, requests: Sequence[Request]) -> list[Plan]:
    """Ask a planner for the plans of some games, by ``plan_batch`` where it has it.

    Returns:
        One plan a request, its waypoints as an array of float, with the seconds that it took (a batch's are
        shared out evenly).

    Raises:
        UserError: the planner fails, or answers with something else than plans.
    """
    start = time.perf_counter()
    try:
        if callable(getattr(planner, "plan_batch", None)):
            plans = list(planner.plan_batch(requests))
        else:
            plans = [planner.plan(r.history, r.current_position, r.limits, r.rng) for r in requests]
    except (UserError, OSError):
        raise
    except Exception as error:  # a planner is anybody's code
        raise UserError(f"planner {called(planner)}: its plan failed: {reason(error)}") from error
    if len(plans) != len(requests):
        raise UserError(f"planner {called(planner)}: {len(plans)} plans for {len(requests)} games")
    each = (time.perf_counter() - start) / max(len(plans), 1)
    plans = [_checked(plan, f"planner {called(planner)}") for plan in plans]
    return [plan if plan.seconds is not None else replace(plan, seconds=each) for plan in plans]


def called(planner: Any) -> str:
    """What messages call a planner, or a class or function that makes one: its name, else its class."""
    names = (getattr(planner, word, None) for word in ("name", "__name__"))
    return next((name for name in names if isinstance(name, str) and name), type(planner).__name__)


def check_described(planner: Any) -> None:
    """Raise UserError where a planner does not say its name, or what it knows."""
    name, tier = getattr(planner, "name", None), getattr(planner, "tier", None)
    if not (isinstance(name, str) and name):
        raise UserError(f"planner {called(planner)}: its name is {name!r}; set it to a word")
    if tier not in TIERS:
        raise UserError(f"planner {name}: its tier is {tier!r}; set it to one of {', '.join(TIERS)}")


def _checked(plan: Any, who: str) -> Plan:
    """A plan whose parts are of their kinds, its waypoints as an array; whether they fit is not asked."""
    if not isinstance(plan, Plan):
        raise UserError(f"{who}: plan must give a fpg_bench.planning.Plan, got {type(plan).__name__}")
    for part, kind in _KINDS.items():
        if not isinstance(value := getattr(plan, part), kind):
            expected = getattr(kind, "__name__", kind)
            raise UserError(f"{who}: its plan's {part} is {value!r}; expected {expected}")
    try:
        return replace(plan, waypoints=np.asarray(plan.waypoints, float))
    except (TypeError, ValueError) as error:
        raise UserError(f"{who}: its waypoints are no array of numbers: {reason(error)}") from error
