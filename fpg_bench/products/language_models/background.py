"""A language model that plans beside the game, for training: each round flies the latest finished plan."""

from __future__ import annotations

import itertools
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.players.planner import BatchPlanner, Patrol, Plan, Request, plan_all
from fpg_bench.products.language_models.llm_planner import LLMPlanner
from fpg_bench.products.language_models.transcript import Flown, place_of


class BackgroundPlanner(BatchPlanner):
    """Runs a language model's planner in its own thread, while the game goes on.

    At the start of a round, a game flies the plan that was finished for its match since the last round; if
    there is none, its present path again, and the circle before its match has had any plan (status
    ``held``). The next plan is then requested from the game's present history. A game has at most one waiting
    request, the newest; the planner takes the game that has waited longest first.

    The delay of a plan depends on the model's speed, so a live run cannot be repeated. The planner's
    transcript notes which plan each round flew; a replay of it flies the same, without a thread.

    It serves one batch of games. A copy begins without any plan.

    Args:
        planner: the language model's planner.

    Attributes:
        flown: number of rounds flown on a plan of each status.
    """

    asks_language_model = True

    def __init__(self, planner: LLMPlanner) -> None:
        self.planner = planner
        self.name, self.tier = f"{planner.name}-beside", planner.tier
        self._transcript = planner.transcript
        self._circle = Patrol("circle", planner.scenario)
        self.flown: Counter[str] = Counter()
        self._games: dict[int, _Game] = {}
        self._lock = threading.Lock()  # guards the state shared with the thread:
        self._waiting: dict[int, Request] = {}  # by game, the one that has waited longest first
        self._ready: dict[int, tuple[Request, Plan]] = {}
        self._is_working = False
        self._error: Exception | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return BackgroundPlanner, (self.planner,)

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the path that each game flies now, without waiting.

        Raises:
            UserError: the planner has failed since the last call, or its transcript does not fit.
            OSError: its transcript cannot be written.
        """
        if self._error is not None:
            failed = f"planner {self.planner.name} failed beside the game: {self._error}"
            raise UserError(failed) from self._error
        plans: list[Plan] = []
        new: list[tuple[Request, Flown]] = []
        for request in requests:
            game = self._game(request)
            plan = self._recorded(game, request)
            if plan is None:
                plan, flown = self._newest(game, request)
                new.append((request, flown))
            game.path, game.is_planned = plan.waypoints, game.is_planned or plan.status != "held"
            plans.append(plan)
        self.flown.update(plan.status for plan in plans)
        self._transcript.add_flown([flown for _, flown in new])
        self._submit([request for request, _ in new])
        return plans

    def _game(self, request: Request) -> _Game:
        """Return the game of a request; one whose match begins starts with the circle."""
        match = (request.seed, request.match)
        game = self._games.get(request.game)
        if game is None or game.match != match or request.round == 0:
            circle = self._circle.plan_batch([request])[0].waypoints
            game = self._games[request.game] = _Game(match, circle)
        return game

    def _newest(self, game: _Game, request: Request) -> tuple[Plan, Flown]:
        """Return the finished plan, else the present path, and its note for the transcript."""
        with self._lock:
            asked, plan = self._ready.pop(request.game, (None, None))
        seed, match, number = place_of(request)
        key: str | None
        if asked is None or plan is None or (asked.seed, asked.match) != game.match or asked.round >= number:
            plan = game.held()
            key, planned_round = plan.source, None
        else:
            key, planned_round = self._key(asked), asked.round
        return plan, Flown(seed=seed, match=match, round=number, plan=key, planned_round=planned_round)

    def _submit(self, requests: Sequence[Request]) -> None:
        with self._lock:
            for request in requests:
                if request.round + 1 < self.planner.scenario.rounds_per_match:
                    self._waiting[request.game] = request
                else:
                    self._waiting.pop(request.game, None)  # no round is left that could fly it
            if self._waiting and not self._is_working:
                self._is_working = True
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
                self._error, self._is_working = error, False

    def _next(self) -> list[Request]:
        """Return as many requests as the planner takes at once; with none, the thread ends."""
        with self._lock:
            games = list(itertools.islice(self._waiting, self.planner.concurrency))
            taken = [self._waiting.pop(game) for game in games]
            self._is_working = bool(taken)
            return taken

    def _recorded(self, game: _Game, request: Request) -> Plan | None:
        """Return the plan that the round flew according to the transcript; None: it does not say."""
        flown = self._transcript.flown(request)
        if flown is None:
            return None
        game.past[request.round] = request
        plan: Plan | None = None
        key: str | None = None
        if flown.planned_round is None:
            plan = game.held()
            key = plan.source
        elif asked := game.past.get(flown.planned_round):
            key = self._key(asked)
            plan = None if key is None else plan_all(self.planner, [asked])[0]
        if plan is None or flown.plan != key:
            problem = f"flew the plan {flown.plan} of round {flown.planned_round}, which is not there"
            raise UserError(self._transcript.complaint(place_of(request), problem))
        return plan

    def _key(self, request: Request) -> str | None:
        """Return the key of the attempt that decided a request's plan, None where no transcript holds it."""
        attempt = self._transcript.decided(*place_of(request))
        return None if attempt is None else attempt.key


@dataclass
class _Game:
    """A game's path in its present match, and its requests in rounds that a transcript knows."""

    match: tuple[int, int]
    path: np.ndarray
    is_planned: bool = False
    past: dict[int, Request] = field(default_factory=dict)

    def held(self) -> Plan:
        return Plan(self.path.copy(), "held" if self.is_planned else "circle", "held")
