"""Cross-play: every verified ally against every verified opponent of its scenario, on the same seeds."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Len, Lt

from fpg_bench.common.schema import Items, NonNegativeInt, PositiveInt
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.play import lost_rounds
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.seeds import PROTOCOL, evaluation_seeds
from fpg_bench.evaluation.store import StrictResult
from fpg_bench.evaluation.suite import Scale
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import SIDES, Abilities, Memory, Player, Prediction
from fpg_bench.players.registry import as_player
from fpg_bench.products.leaderboard.cases import Case, verified_cases
from fpg_bench.products.leaderboard.encounters import Kind, Verification
from fpg_bench.products.leaderboard.folders import crossplay_file
from fpg_bench.products.leaderboard.playing import Part, parts_of, running_player
from fpg_bench.products.leaderboard.result import round_finite
from fpg_bench.products.leaderboard.tracks import PUBLIC, SCENARIOS, ranked_by
from fpg_bench.products.leaderboard.verdicts import (
    EXACT,
    SHARE_OF_ROUNDS,
    Replayed,
    Tolerances,
    Verdict,
    Verdicts,
    Within,
)
from fpg_bench.products.leaderboard.verdicts import WITHIN as SAME_WITHIN

_logger = logging.getLogger(__name__)

ROUNDS = 100  # of each pair, distributed evenly over the training seeds of both
WITHIN = 0.005  # slack of the bound of a return
_NAMED = 5  # rows that are left out

_Rewards = Annotated[Items[Annotated[float, Gt(-1e6), Lt(1e6)]], Len(1)]


# Entries and pairs


@dataclass(frozen=True)
class CrossplayEntry:
    """A verified entry that plays a side.

    Attributes:
        slug: its name, which is unique on its side.
        side: ``ally`` or ``opponent``.
        preset: the scenario of its track; both of a pair have the same.
        parts: its training seeds, or its script.
        scenario: the preset with the path of its track; a pair plays the opponent's.
        scale: the scale of its track.
        season: the seed of the season, from which the evaluation seeds follow.
    """

    slug: str
    side: str
    preset: str
    parts: tuple[Part, ...]
    scenario: Scenario
    scale: Scale
    season: str

    @classmethod
    def of(cls, case: Case) -> CrossplayEntry:
        """Return the entry of a case."""
        submission, public = case.submission, case.suites[PUBLIC]
        scenario = as_scenario(submission.scenario, opponent_path=submission.path or "pursuit")
        return cls(
            submission.slug,
            submission.track,
            submission.scenario,
            tuple(parts_of(submission)),
            scenario,
            public.scale,
            case.suites[ranked_by(case.suites)].season,
        )

    @property
    def name(self) -> str:
        """Its name on the board, ``side/slug``."""
        return f"{self.side}/{self.slug}"

    @cached_property
    def identity(self) -> list[str]:
        """Fingerprints of its parts, which decide how it plays."""
        return [part.fingerprint for part in self.parts]

    @cached_property
    def scenario_hash(self) -> str:
        """Hash of its game."""
        return self.scenario.hash


class EntryPair(NamedTuple):
    """Two entries that meet."""

    ally: CrossplayEntry
    opponent: CrossplayEntry

    @property
    def key(self) -> str:
        """See :func:`pair_key`."""
        return pair_key(self.ally, self.opponent)

    @property
    def name(self) -> str:
        """Its name in messages."""
        return f"{self.ally.slug} - {self.opponent.slug}"


class Pair(StrictResult):
    """Result of a pair.

    Attributes:
        ally, opponent: their names.
        key: see :func:`pair_key`.
        rounds: number of rounds.
        ally_rewards, opponent_rewards: return per step of each training seed of a side.
        jamming_success_rate: over all rounds.
        lost: number of rounds lost by an invalid answer, ``(ally's, opponent's)``.
    """

    ally: str
    opponent: str
    key: str
    rounds: PositiveInt
    ally_rewards: _Rewards
    opponent_rewards: _Rewards
    jamming_success_rate: Annotated[float, Ge(0), Le(1)]
    lost: Annotated[Items[NonNegativeInt], Len(2, 2)]

    def rewards(self, side: str) -> tuple[float, ...]:
        """Return the return per step of each training seed of a side."""
        return self.ally_rewards if side == "ally" else self.opponent_rewards

    def reward(self, side: str) -> float:
        """Return a side's return per step."""
        return float(np.mean(self.rewards(side)))

    def is_of(self, ally: CrossplayEntry, opponent: CrossplayEntry) -> bool:
        """Return True if it can be the result of these two entries, with as many training seeds as they have.

        A side that lost all rounds earned no more than such rounds give.
        """
        return (self.ally, self.opponent) == (ally.slug, opponent.slug) and all(
            len(rewards := self.rewards(each.side)) == len(each.parts)
            and (lost < self.rounds or (lost == self.rounds and max(rewards) <= each.scale.lost + WITHIN))
            for each, lost in zip((ally, opponent), self.lost, strict=True)
        )


def players_of(cases: Iterable[Case]) -> tuple[list[CrossplayEntry], list[CrossplayEntry]]:
    """Return the allies and opponents among verified cases, scenario by scenario."""
    entries = [CrossplayEntry.of(case) for case in cases if case.submission.track in SIDES]
    entries.sort(key=lambda entry: SCENARIOS.index(entry.preset))
    allies, opponents = ([entry for entry in entries if entry.side == side] for side in SIDES)
    return allies, opponents


def pair_key(ally: CrossplayEntry, opponent: CrossplayEntry) -> str:
    """Return a hash of everything that decides a pair's result, as 16 hexadecimal digits."""
    content = [ally.identity, opponent.identity, opponent.scenario_hash, PROTOCOL, ally.season, ROUNDS]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Pairs:
    """The allies and opponents of a board, and the results of their pairs.

    Attributes:
        allies, opponents: the entries, in each scenario by name.
        results: by :func:`pair_key`.
    """

    allies: list[CrossplayEntry]
    opponents: list[CrossplayEntry]
    results: Mapping[Hashable, Pair]

    def every(self) -> list[EntryPair]:
        """Return all pairs, ally by ally; those of a pair play the same scenario."""
        pairings = [EntryPair(ally, opponent) for ally in self.allies for opponent in self.opponents]
        return [each for each in pairings if each.ally.preset == each.opponent.preset]

    def of(self, preset: str) -> Pairs:
        """Return the entries of a scenario, and all results."""
        allies, opponents = (
            [entry for entry in entries if entry.preset == preset]
            for entries in (self.allies, self.opponents)
        )
        return replace(self, allies=allies, opponents=opponents)


def read_pairs(board: Path, players: tuple[list[CrossplayEntry], list[CrossplayEntry]]) -> Pairs:
    """Read the results of pairs of these players; all other lines are left out.

    Args:
        board: the leaderboard's folder.
        players: allies and opponents.

    Raises:
        UserError: the file cannot be read.
    """
    wanted = {each.key: each for each in Pairs(*players, {}).every()}
    known = PAIRS.read(board)
    results: dict[Hashable, Pair] = {
        pair.key: pair for pair in known.values() if pair.key in wanted and pair.is_of(*wanted[pair.key])
    }
    if left := [f"{pair.ally} - {pair.opponent}" for pair in known.values() if pair.key not in results]:
        names = ", ".join(left[:_NAMED])
        _logger.info(f"{crossplay_file(board)}: {len(left)} left out, of others or impossible: {names}")
    return Pairs(*players, results)


def fully_played(pairs: Pairs) -> tuple[list[CrossplayEntry], list[CrossplayEntry]]:
    """Return the entries of a scenario, but for those with the largest shares of missing pairs.

    They are removed one by one, until no pair is missing.
    """
    allies, opponents = list(pairs.allies), list(pairs.opponents)
    keys = [[pair_key(a, o) for o in opponents] for a in allies]
    there = np.array([[key in pairs.results for key in row] for row in keys], bool)
    while not there.all():
        of_ally, of_opponent = there.mean(axis=1), there.mean(axis=0)
        axis = 0 if of_ally.min() <= of_opponent.min() else 1
        worst = int((of_ally, of_opponent)[axis].argmin())
        (allies, opponents)[axis].pop(worst)
        there = np.delete(there, worst, axis)
    return allies, opponents


def verify_pairs(board: str | Path, how: Verification) -> list[Verdict]:
    """Play the pairs of a board's entries, and compare with their results or write them.

    Results of entries that are gone are dropped.

    Args:
        board: the leaderboard's folder.
        how: which are played again; of named entries, all that they are part of.

    Returns:
        The bad verdicts, and one on all pairs; none if there are no pairs.
    """
    board, verdicts = Path(board), Verdicts(logging.DEBUG)
    every = Pairs(*players_of(verified_cases(board)), {}).every()
    order = {each.key: number for number, each in enumerate(every)}
    names = set(how.names)
    wanted = [each for each in every if not names or names & {each.ally.name, each.opponent.name}]
    PAIRS.verify(board, wanted, verdicts, how, lambda pair: order.get(pair.key))
    if not verdicts.all():
        return []
    bad, all_of_them = verdicts.bad(), Verdicts()
    for verdict in bad:
        all_of_them.give(verdict.name, False, verdict.line)
    all_of_them.give("cross-play", not bad, f"{len(wanted)} pairs, {len(bad)} bad verdicts")
    return all_of_them.all()


# Playing a pair


def _compare(pair: EntryPair, now: Pair, then: Pair) -> list[str]:
    """Return what does not hold of a pair's result."""
    units = {each.side: each.scale.top - each.scale.zero for each in pair}
    units |= {"steps": 1.0, "rounds": now.rounds}
    is_scripted = all(isinstance(part.plays, str) for each in pair for part in each.parts)
    return TOLERANCES.of([Replayed(now, then, units, is_scripted=is_scripted, is_same=is_scripted)])


TOLERANCES = Tolerances(
    Pair,
    ally=EXACT,
    opponent=EXACT,
    key=EXACT,
    rounds=EXACT,
    ally_rewards=Within(SAME_WITHIN, "ally", dealt=True),
    opponent_rewards=Within(SAME_WITHIN, "opponent", dealt=True),
    jamming_success_rate=Within(SAME_WITHIN, "steps"),
    lost=Within(1 - SHARE_OF_ROUNDS, "rounds", of=" by side"),
)


def play_pair(ally: CrossplayEntry, opponent: CrossplayEntry) -> Pair:
    """Play one pair: all combinations of both sides' training seeds, equally often.

    A round that a side loses by an invalid answer counts as jammed throughout if it is the ally's, and as
    never jammed if it is the opponent's. Its return is that of a lost round in its track.
    """
    games = np.arange(ROUNDS)
    of_ally = games % len(ally.parts)
    of_opponent = games // len(ally.parts) % len(opponent.parts)
    duel, lost = play_rounds(ally, of_ally, opponent, of_opponent, evaluation_seeds(ROUNDS, ally.season))
    rates = duel.batch.tallies["jammed"] / duel.batch.tallies["steps"]
    rates[lost[0] & ~lost[1]], rates[lost[1] & ~lost[0]] = 1.0, 0.0
    return Pair(
        ally=ally.slug,
        opponent=opponent.slug,
        key=pair_key(ally, opponent),
        rounds=ROUNDS,
        ally_rewards=_means(rewards_of(duel, ally, lost[0]), of_ally),
        opponent_rewards=_means(rewards_of(duel, opponent, lost[1]), of_opponent),
        jamming_success_rate=round_finite(rates.mean()),
        lost=(int(lost[0].sum()), int(lost[1].sum())),
    )


def play_rounds(
    ally: CrossplayEntry,
    of_ally: np.ndarray,
    opponent: CrossplayEntry,
    of_opponent: np.ndarray,
    seeds: Sequence[int],
) -> tuple[TwoPlayerBatch, tuple[np.ndarray, np.ndarray]]:
    """Play a round of each game between parts of two entries, by the opponent's rules.

    Args:
        ally, opponent: the entries.
        of_ally, of_opponent: ``(n,)`` the part that plays each game.
        seeds: ``(n,)`` of the games.

    Returns:
        The games at their end, and ``(n,)`` bool of each side: the rounds that it lost by an invalid answer.

    Raises:
        PolicyFailed: a policy's process died or exceeded its limits.
    """
    duel = TwoPlayerBatch(opponent.scenario, len(seeds))
    with _team(ally, of_ally, duel) as one, _team(opponent, of_opponent, duel) as other:
        play_round(make_match(duel, one, other), seeds=np.array(seeds))
        return duel, (one.invalid.copy(), other.invalid.copy())


def rewards_of(duel: TwoPlayerBatch, entry: CrossplayEntry, lost: np.ndarray) -> np.ndarray:
    """Return ``(n,)`` an entry's return per step in each game; a lost round counts as lost in its track."""
    rewards: np.ndarray = duel.batch.tallies[f"{entry.side}_return"] / duel.batch.tallies["steps"]
    rewards[lost] = min([entry.scale.lost, *rewards[~lost]])
    return rewards


def _means(rewards: np.ndarray, runners: np.ndarray) -> tuple[float, ...]:
    """Return the mean reward of each of a side's parts."""
    return tuple(round_finite(rewards[runners == k].mean()) for k in range(runners.max() + 1))


@contextlib.contextmanager
def _team(entry: CrossplayEntry, runners: np.ndarray, duel: TwoPlayerBatch) -> Iterator[Team]:
    with contextlib.ExitStack() as stack:
        plays = [stack.enter_context(running_player(part, shipped_in_process=True)) for part in entry.parts]
        yield Team([as_player(player, entry.side, duel.scenario) for player in plays], runners)


class Team:
    """Plays each game of a batch with one of several players, whose states are kept apart.

    Args:
        players: the members.
        runners: ``(n,)`` the member that plays each game.
    """

    def __init__(self, players: Sequence[Player], runners: np.ndarray) -> None:
        games = (np.flatnonzero(runners == k) for k in range(len(players)))
        self._members = [(player, own) for player, own in zip(players, games, strict=True) if len(own)]
        self._resets = [(Abilities.of(player).reset, own) for player, own in self._members]

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Pass the masked games' seeds on to the members that draw."""
        for reset, games in self._resets:
            if reset is not None:
                reset(mask[games], seeds[games])

    def predict(
        self,
        observation: np.ndarray,
        state: Memory = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Play one step; see :class:`fpg_bench.players.player.Player`."""
        memories = [None] * len(self._members) if state is None else state
        actions, after = np.empty((len(observation), ACTION_SIZE), np.float32), []
        for (player, games), memory in zip(self._members, memories, strict=True):
            starts = None if episode_start is None else episode_start[games]
            actions[games], memory = player.predict(observation[games], memory, starts, deterministic)
            after.append(memory)
        return actions, after

    @property
    def invalid(self) -> np.ndarray:
        """``(n,)`` bool: games whose current round a member has lost by an invalid answer."""
        lost = np.zeros(sum(len(games) for _, games in self._members), bool)
        for player, games in self._members:
            lost[games] = lost_rounds(player, len(games))
        return lost


def _play(pair: EntryPair) -> Pair:
    return play_pair(*pair)


def _describe(pair: EntryPair, now: Pair) -> str:
    return f"the ally keeps {now.reward('ally'):.2f} per step"


PAIRS = Kind("crossplay", Pair, crossplay_file, _play, _compare, _describe)
