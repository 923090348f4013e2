"""Playing of an entry against a rival of a suite: all matches as one batch, summed up in one record.

The entry is a player of one side, or a planner of the opponent's path.
"""

from __future__ import annotations

import dataclasses
import hashlib
import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError, printable
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.entry import EvaluatedPlayer
from fpg_bench.evaluation.record import (
    HASHED_TALLIES,
    HOP_BITS,
    HopCounts,
    Plans,
    Record,
    conditional_entropy,
)
from fpg_bench.evaluation.rounds import MatchBatch, SidePolicy, make_match, play_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite
from fpg_bench.game.metrics import pool as pooled_tally
from fpg_bench.game.spec import game_product
from fpg_bench.players.planner import Plan, as_planner
from fpg_bench.players.player import LosesRounds

SeedSource = Callable[[int], Sequence[int]]  # returns so many seeds
_DIGITS = 3  # of a round's return
_logger = logging.getLogger(__name__)


def play(
    entry: EvaluatedPlayer,
    suite: Suite,
    rival: Rival,
    seeds: SeedSource | None = None,
    on_round: Callable[[int], None] = lambda played: None,
) -> Record:
    """Play all matches of an entry against a rival.

    An action of the player that is not finite loses that game's round; zeros are played in its place.

    Args:
        entry: the player or planner that is measured.
        suite: the suite of the rival.
        rival: the rival.
        seeds: returns the matches' seeds; None: the evaluation seeds of the suite's season.
        on_round: called with the number of rounds of each match that were played.

    Raises:
        UserError: a player or planner that cannot be made, or that fails; a language model none of whose
            plans is valid, since its score would be that of the paths flown in their place; a player
            that loses every round by actions that are not finite.
    """
    player = entry.make(rival)
    match, judged = match_of(player, suite, rival), None
    if suite.side != PLANNER:
        judged = _Judged(getattr(match, suite.side), match.duel.count)
        match = dataclasses.replace(match, **{suite.side: judged})  # type: ignore[arg-type]
    sums = RoundSums(suite, match)
    for duel in rounds(match, suite, seeds, on_step=sums.hops.count):
        lost = lost_rounds(player, duel.count)
        sums.add(lost if judged is None else lost | judged.lost)
        on_round(len(sums.returns))
    if judged is not None and judged.rounds:
        _tell_lost(f"{entry.name} against {rival.name}", judged.rounds, duel.count * suite.rounds_per_match)
    record = sums.record(entry, rival)
    if (plans := record.plans) is not None and plans.valid == 0:
        raise UserError(
            f"planner {entry.name} against {rival.name}: none of {sum(plans.statuses.values())} plans is "
            f"valid, so it has no score ({sums.commonest_problem()}); mend that and record it in another "
            "folder"
        )
    return record


def match_of(player: Any, suite: Suite, rival: Rival, matches: int | None = None) -> MatchBatch:
    """Return the match batch in which a player, or a planner for a suite of planners, meets a rival."""
    scenario, count = rival.scenario, matches or suite.matches
    if suite.game is not None:
        match: MatchBatch = game_product(suite.game.id).make_match(player, suite, rival, count)
        return match
    if suite.side == PLANNER:
        duel = TwoPlayerBatch(scenario, count, as_planner(player, scenario))
        return make_match(duel, rival.players, suite.opponent)
    planner = None if rival.planner is None else as_planner(rival.planner, scenario)
    ally, opponent = (player, rival.players) if suite.side == "ally" else (rival.players, player)
    return make_match(TwoPlayerBatch(scenario, count, planner), ally, opponent)


def rounds(
    match: MatchBatch,
    suite: Suite,
    seeds: SeedSource | None = None,
    on_step: Callable[[], None] | None = None,
) -> Iterator[TwoPlayerBatch]:
    """Play all rounds of new matches; yield the games at the end of each round."""
    count = match.duel.count
    first = np.array(evaluation_seeds(count, suite.season) if seeds is None else seeds(count))
    for number in range(suite.rounds_per_match):
        play_round(match, seeds=None if number else first, on_step=on_step)
        yield match.duel


def lost_rounds(player: object, count: int) -> np.ndarray:
    """Return ``(count,)`` bool: present rounds that a player has lost by an invalid answer."""
    return np.array(player.invalid, bool) if isinstance(player, LosesRounds) else np.zeros(count, bool)


class _Judged:
    """Policy of the side that is measured; an action that is not finite loses the round of its game.

    Attributes:
        lost: ``(n,)`` bool, the games whose present round is lost.
        rounds: number of rounds that were lost.
    """

    def __init__(self, policy: SidePolicy, count: int) -> None:
        self._policy = policy
        self.lost, self.rounds = np.zeros(count, bool), 0

    def begin(self, mask: np.ndarray) -> None:
        self._policy.begin(mask)
        self.lost[mask] = False

    def act(self) -> np.ndarray:
        actions = self._policy.act()
        if actions.dtype.kind == "f" and not np.isfinite(actions).all():
            wrong = ~np.isfinite(actions).reshape(len(actions), -1).all(axis=1)
            self.rounds += int((wrong & ~self.lost).sum())
            self.lost |= wrong
            actions = actions.copy()
            actions[wrong] = 0
        return actions


def _tell_lost(who: str, lost: int, rounds: int) -> None:
    """Log the number of rounds that are lost by actions that are not finite; all of them are an error."""
    if lost == rounds:
        raise UserError(f"{who}: all {rounds:,} rounds are lost: its actions are not finite")
    _logger.warning("%s: %s of %s rounds are lost: an action is not finite", who, f"{lost:,}", f"{rounds:,}")


class RoundSums:
    """Sums over the rounds of an entry against a rival, added as they end."""

    def __init__(self, suite: Suite, match: MatchBatch) -> None:
        self._suite, self._duel = suite, match.duel
        self.hops = HopCounts(match.duel.batch)
        self._tallies: list[np.ndarray] = []
        self._clean: list[dict[str, float]] = []
        self._histogram = np.zeros((2, suite.scenario.frequency_points), np.int64)
        self._lost: list[np.ndarray] = []
        self._plans: list[Plan] = []
        self._digest = hashlib.sha256()
        self.returns: list[np.ndarray] = []

    def add(self, lost: np.ndarray) -> None:
        """Add the present round of every game, of which some are lost."""
        batch = self._duel.batch
        self._tallies.append(batch.tallies.copy())
        self._clean.append(batch.clean_sum())
        self._histogram += batch.histograms.sum(axis=0)
        self._lost.append(lost)
        self.returns.append(batch.tallies[self._suite.return_name].copy())
        for part in (
            batch.games["seed"],
            *(batch.tallies[name] for name in HASHED_TALLIES),
            batch.histograms,
        ):
            self._digest.update(np.ascontiguousarray(part).tobytes())
        if self._suite.side == PLANNER:
            self._plans += [plan for plan in self._duel.plans if plan is not None]

    def record(self, entry: EvaluatedPlayer, rival: Rival) -> Record:
        """Return the record of the rounds that an entry played against a rival."""
        returns, lost = np.array(self.returns).T, np.array(self._lost).T
        if lost.any():
            worst = self._suite.scale.lost * self._suite.scenario.steps_per_round
            returns[lost] = min([worst, *returns[~lost]])
        tally = pooled_tally(np.concatenate(self._tallies))
        tally |= {name: sum(each[name] for each in self._clean) for name in self._clean[0]}
        tally[HOP_BITS] = conditional_entropy(self.hops.counts) * tally["hops"]
        ally_points, jam_points = (tuple(side) for side in self._histogram.tolist())
        return Record(
            suite=self._suite.name,
            suite_hash=self._suite.hash[:16],
            entry=entry.name,
            training_seed=entry.training_seed,
            fingerprint=entry.fingerprint[:16],
            rival=rival.name,
            returns=tuple(np.round(returns.ravel(), _DIGITS).tolist()),
            tally={name: float(f"{value:.9g}") for name, value in tally.items()},
            ally_points=ally_points,
            jam_points=jam_points,
            lost=int(lost.sum()),
            rounds_sha256=self._digest.hexdigest(),
            plans=self._plan_statistics() if self._plans else None,
        )

    def commonest_problem(self) -> str:
        """Return the most frequent reason for an invalid plan, and how often it was given."""
        ((problem, count),) = Counter(plan.problem or plan.status for plan in self._plans).most_common(1)
        return f"{count} times: {printable(problem)}"

    def _plan_statistics(self) -> Plans:
        statuses = Counter(sorted(plan.status for plan in self._plans))
        tokens = [plan.tokens for plan in self._plans if plan.tokens is not None]
        seconds = sum(plan.seconds or 0.0 for plan in self._plans)
        signs = [plan.useless for plan in self._plans if plan.useless is not None]
        useless = dict(Counter(sorted(filter(None, signs)))) if signs else None
        return Plans(dict(statuses), int(sum(tokens)) if tokens else None, round(seconds, 6), useless)
