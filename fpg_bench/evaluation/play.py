"""Playing: an entry against a rival of a suite, all matches as one batch, into one line.

There are two ways to meet: a side of the game against the other side's players, and a planner of the
opponent's path against allies. All that comes after is the same.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.entry import Entry
from fpg_bench.evaluation.record import TALLIES, Plans, Record
from fpg_bench.evaluation.rounds import MatchBatch, make_match, play_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite
from fpg_bench.game.metrics import pool as pooled_tally
from fpg_bench.planning import as_planner

Seeds = Callable[[int], list[int]]  # gives so many
LOST_SCORE = -100.0  # what a round scores that was lost by an answer that is no action, at the most
_DIGITS = 3  # of a round's return


def play(
    entry: Entry,
    suite: Suite,
    rival: Rival,
    seeds: Seeds | None = None,
    on_round: Callable[[int], None] = lambda played: None,
) -> Record:
    """Play all matches of an entry against a rival.

    Args:
        entry: who is measured.
        suite: what the rival belongs to.
        rival: whom it meets.
        seeds: gives the matches' seeds; None: the evaluation seeds of the suite's season.
        on_round: called with the number of rounds of each match that were played.

    Raises:
        UserError: a player or planner that can't be had, or that fails.
    """
    who = entry.make(rival)
    table = match_of(who, suite, rival)
    sums = _Sums(suite)
    for duel in rounds(table, suite, seeds):
        sums.add(duel, lost_rounds(who, duel.count))
        on_round(len(sums.returns))
    return Record(
        suite=suite.name,
        suite_hash=suite.hash[:16],
        entry=entry.name,
        training_seed=entry.training_seed,
        fingerprint=entry.fingerprint[:16],
        rival=rival.name,
        **sums.fields(),
    )


def match_of(who: Any, suite: Suite, rival: Rival, matches: int | None = None) -> MatchBatch:
    """Return the match batch in which a player (or planner) meets a rival."""
    scenario, count = rival.scenario, matches or suite.matches
    if suite.side == PLANNER:
        return make_match(
            TwoPlayerBatch(scenario, count, as_planner(who, scenario)), rival.players, suite.opponent
        )
    planner = None if rival.planner is None else as_planner(rival.planner, scenario)
    sides = {suite.side: who, suite.other_side: rival.players}
    return make_match(TwoPlayerBatch(scenario, count, planner), **sides)


def rounds(match: MatchBatch, suite: Suite, seeds: Seeds | None = None) -> Iterator[TwoPlayerBatch]:
    """Play all rounds of new matches; yield the games at the end of each round."""
    count = match.duel.count
    first: Any = np.array(evaluation_seeds(count, suite.season) if seeds is None else seeds(count))
    for number in range(suite.rounds_per_match):
        play_round(match, seeds=None if number else first)
        yield match.duel


def lost_rounds(player: Any, count: int) -> np.ndarray:
    """Return ``(count,)`` bool: present rounds that a player has lost by an invalid answer."""
    invalid = getattr(player, "invalid", None)
    return np.zeros(count, bool) if invalid is None else np.array(invalid, bool)


class _Sums:
    """Sums over the rounds, added as they end."""

    def __init__(self, suite: Suite) -> None:
        self._suite = suite
        self._tallies: list[np.ndarray] = []
        self._histogram: Any = 0
        self._lost: list[np.ndarray] = []
        self._plans: list[Any] = []
        self._digest = hashlib.sha256()
        self.returns: list[np.ndarray] = []

    def add(self, duel: TwoPlayerBatch, lost: np.ndarray) -> None:
        batch = duel.batch
        self._tallies.append(batch.tallies.copy())
        self._histogram = self._histogram + batch.histograms.sum(axis=0)
        self._lost.append(lost)
        self.returns.append(batch.tallies[self._suite.return_name].copy())
        for part in (batch.games["seed"], *(batch.tallies[name] for name in TALLIES), batch.histograms):
            self._digest.update(np.ascontiguousarray(part).tobytes())
        if self._suite.side == PLANNER:
            self._plans += duel.plans

    def fields(self) -> dict[str, Any]:
        """Return the fields of a record that describe the rounds."""
        returns, lost = np.array(self.returns).T, np.array(self._lost).T
        if lost.any():
            worst = self._suite.scale.reward(LOST_SCORE) * self._suite.scenario.steps_per_round
            returns[lost] = min([worst, *returns[~lost]])
        tally = pooled_tally(np.concatenate(self._tallies))
        ally_points, jam_points = (tuple(side) for side in self._histogram.tolist())
        return {
            "returns": tuple(np.round(returns.ravel(), _DIGITS).tolist()),
            "tally": {name: float(f"{tally[name]:.9g}") for name in TALLIES},
            "ally_points": ally_points,
            "jam_points": jam_points,
            "lost": int(lost.sum()),
            "rounds_sha256": self._digest.hexdigest(),
            "plans": self._plan_statistics() if self._plans else None,
        }

    def _plan_statistics(self) -> Plans:
        statuses = Counter(sorted(plan.status for plan in self._plans))
        tokens = [plan.tokens for plan in self._plans if plan.tokens is not None]
        seconds = sum(plan.seconds or 0.0 for plan in self._plans)
        signs = [plan.useless for plan in self._plans if plan.useless is not None]
        useless = dict(Counter(sorted(filter(None, signs)))) if signs else None
        return Plans(dict(statuses), int(sum(tokens)) if tokens else None, round(seconds, 6), useless)
