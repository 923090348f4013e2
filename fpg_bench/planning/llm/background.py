"""Planning beside the game, for training with a slow planner: the plan that is ready is flown."""

from __future__ import annotations

import itertools
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.llm.transcript import Transcript, place_of
from fpg_bench.planning.patterns import Patrol
from fpg_bench.planning.planner import BatchPlanner, Plan, Request, plan_all


class BackgroundPlanner(BatchPlanner):
    """Lets a planner plan in a thread of its own, while the game goes on.

    When a round starts, a game flies the plan that has come in for its match since the last round; if there
    is none, its present path again, and the circle while its match has had no plan at all (status ``held``).
    The next plan is made from what the game shows at that moment. A game has at most one request waiting,
    the newest; the planner takes the game that has waited longest first.

    How far a plan is behind depends on how fast it was made, so such a run cannot be repeated live
    (``repeatable`` is False). A planner with a transcript notes there which plan each round flew; with that
    transcript in mode ``replay`` the same is flown, without a thread.

    It serves one batch of games. A copy begins with nothing planned.

    Args:
        planner: who plans, by ``plan`` or ``plan_batch``.
        scenario: what is played; None: the planner's own.

    Attributes:
        flown: how many rounds were flown on a plan of each status.

    Raises:
        UserError: no scenario.
    """

    def __init__(self, planner: Any, scenario: Scenario | None = None) -> None:
        played = scenario or getattr(planner, "scenario", None)
        if played is None:
            raise UserError(f"planner {planner.name}: beside the game it needs the scenario; pass it, too")
        self.planner, self.scenario = planner, played
        self.name, self.tier = f"{planner.name}-beside", planner.tier
        self.asks_language_model = getattr(planner, "asks_language_model", False)
        self._transcript = getattr(planner, "transcript", None) or Transcript()
        self.repeatable = self._transcript.mode == "replay"
        self._circle = Patrol("circle", played)
        self.flown: Counter[str] = Counter()
        self._games: dict[int, _Game] = {}
        self._lock = threading.Lock()  # guards what the thread and the caller share, which is:
        self._waiting: dict[int, Request] = {}  # by game, the one that has waited longest first
        self._ready: dict[int, tuple[Request, Plan]] = {}
        self._working = False
        self._error: Exception | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return BackgroundPlanner, (self.planner, self.scenario)

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """What each game flies now; gives an answer at once.

        Raises:
            UserError: the planner has failed since the last call, or its transcript does not fit.
            OSError: its transcript cannot be written.
        """
        if self._error is not None:
            failed = f"planner {self.planner.name} failed beside the game: {self._error}"
            raise UserError(failed) from self._error
        plans: list[Plan] = []
        new: list[tuple[Request, Row]] = []
        for request in requests:
            game = self._game(request)
            plan = self._noted(game, request)
            if plan is None:
                plan, line = self._newest(game, request)
                new.append((request, line))
            game.path, game.planned = plan.waypoints, game.planned or plan.status != "held"
            plans.append(plan)
        self.flown.update(plan.status for plan in plans)
        self._transcript.add_flown([line for _, line in new])
        self._submit([request for request, _ in new])
        return plans

    def _game(self, request: Request) -> _Game:
        """The game of a request; one whose match begins has the circle before it."""
        match = (request.seed, request.match)
        game = self._games.get(request.game)
        if game is None or game.match != match or request.round == 0:
            circle = self._circle.plan_batch([request])[0].waypoints
            game = self._games[request.game] = _Game(match, circle)
        return game

    # Live

    def _newest(self, game: _Game, request: Request) -> tuple[Plan, Row]:
        """The plan that has come in, else the present path; and the line that notes it."""
        with self._lock:
            asked, plan = self._ready.pop(request.game, (None, None))
        seed, match, number = place_of(request)
        line: Row = {"seed": seed, "match": match, "round": number}
        if asked is None or plan is None or (asked.seed, asked.match) != game.match or asked.round >= number:
            held = game.held()
            return held, {**line, "plan": held.source, "planned_round": None}
        return plan, {**line, "plan": self._key(asked), "planned_round": asked.round}

    def _submit(self, requests: Sequence[Request]) -> None:
        with self._lock:
            for request in requests:
                if request.round + 1 < self.scenario.rounds_per_match:
                    self._waiting[request.game] = request
                else:
                    self._waiting.pop(request.game, None)  # no round is left that could fly it
            if self._waiting and not self._working:
                self._working = True
                # A daemon: a call that is under way does not hold up the end of the program
                threading.Thread(target=self._work, name=self.name, daemon=True).start()

    def _work(self) -> None:
        try:
            while requests := self._next():
                plans = plan_all(self.planner, requests)
                with self._lock:
                    pairs = zip(requests, plans, strict=True)
                    self._ready |= {request.game: (request, plan) for request, plan in pairs}
        except Exception as error:
            with self._lock:
                self._error, self._working = error, False

    def _next(self) -> list[Request]:
        """As many requests as the planner plans at once; none: the thread ends."""
        with self._lock:
            count = getattr(self.planner, "concurrency", len(self._waiting))
            taken = [self._waiting.pop(game) for game in list(itertools.islice(self._waiting, count))]
            self._working = bool(taken)
            return taken

    # From a transcript

    def _noted(self, game: _Game, request: Request) -> Plan | None:
        """What the transcript says that the round flew; None: it says nothing."""
        line = self._transcript.flown(request)
        if line is None:
            return None
        game.past[request.round] = request
        asked = game.past.get(line["planned_round"])
        plan: Plan | None = game.held()
        key: str | None = game.held().source
        if line["planned_round"] is not None:
            key = None if asked is None else self._key(asked)
            plan = None if asked is None or key is None else plan_all(self.planner, [asked])[0]
        if plan is None or line["plan"] != key:
            what = f"flew the plan {line['plan']} of round {line['planned_round']}, which is not there"
            raise UserError(self._transcript.complaint(place_of(request), what))
        return plan

    def _key(self, request: Request) -> str | None:
        """The key of the attempt that decided a request's plan, None where no transcript holds it."""
        attempt = self._transcript.decided(request)
        return None if attempt is None else attempt.key


@dataclass
class _Game:
    """What a game flies in its present match, and its requests so far in rounds that a transcript knows."""

    match: tuple[int, int]
    path: np.ndarray
    planned: bool = False
    past: dict[int, Request] = field(default_factory=dict)

    def held(self) -> Plan:
        return Plan(self.path.copy(), "held" if self.planned else "circle", "held")
