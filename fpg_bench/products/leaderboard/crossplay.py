"""Cross-play: every verified ally against every verified opponent of its scenario, on the same seeds."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import random
import secrets
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Len, Lt

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Workers
from fpg_bench.common.rows import Row
from fpg_bench.common.schema import Items, NonNegativeInt, PositiveInt, parse
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.play import LOST_SCORE, lost_rounds
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.seeds import PROTOCOL, evaluation_seeds
from fpg_bench.evaluation.store import EncounterStore, StrictResult
from fpg_bench.evaluation.suite import Scale, Suite
from fpg_bench.game.flight import rotary_wing_w
from fpg_bench.game.rules import radio_record
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import SIDES, Abilities, Memory, Player, Prediction
from fpg_bench.players.registry import as_player
from fpg_bench.products.leaderboard.folders import crossplay_file, submission_folders
from fpg_bench.products.leaderboard.playing import Part, parts_of, running_player, work_store
from fpg_bench.products.leaderboard.result import round_finite
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import PUBLIC, SCENARIOS, ranked_by
from fpg_bench.products.leaderboard.verdicts import (
    EXACT,
    SHARE_OF_ROUNDS,
    Check,
    Replayed,
    Tolerances,
    Verdict,
    Verdicts,
    Within,
    check_share,
    draw,
)
from fpg_bench.products.leaderboard.verdicts import WITHIN as SAME_WITHIN
from fpg_bench.products.leaderboard.verification import Case, board_reader, load_case

_logger = logging.getLogger(__name__)

ROUNDS = 100  # of each pair, distributed evenly over the training seeds of both
_UNEVEN = 0.1  # of the spread between training seeds: they do not all play as many rounds
_LEAST_SNR_DB = -100.0  # at full power from one metre, the opponent brings it down to about -50 dB
WITHIN = 0.005  # slack of the bounds of a return

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
    def of(cls, submission: Submission, public: Suite, season: str) -> CrossplayEntry:
        """Return the entry of a submission that plays this public suite."""
        scenario = as_scenario(submission.scenario, opponent_path=submission.path or "pursuit")
        return cls(
            submission.slug,
            submission.track,
            submission.scenario,
            tuple(parts_of(submission)),
            scenario,
            public.scale,
            season,
        )

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
        """Return True if it is the result of these two entries, with as many training seeds as they have."""
        names = (self.ally, self.opponent) == (ally.slug, opponent.slug)
        seeds = len(self.ally_rewards), len(self.opponent_rewards)
        return names and seeds == (len(ally.parts), len(opponent.parts))

    def is_possible(self, ally: CrossplayEntry, opponent: CrossplayEntry) -> bool:
        """Return True if rounds of these two entries can have this result (Eq. 5 and 6).

        The ally earns at most the greatest worth of its link. The opponent earns at most what the ally's link
        is worth less than that, plus the reward for being near. Neither earns less than the costs of the
        whole round, or than a lost round counts. What the opponent took in a round that the ally lost is not
        in the ally's return.
        """
        scenario, lost_by_ally = opponent.scenario, self.lost[0] / self.rounds
        if self.rounds != ROUNDS or max(self.lost) > self.rounds:
            return False
        bounds = _step_bounds(scenario)
        if bounds is None:
            return True
        lowest, most, costs = bounds
        least = min(lowest - costs, ally.scale.reward(LOST_SCORE))
        left = most - self.reward("ally") + lost_by_ally * (most - lowest)
        near = max(scenario.distance_reward, 0.0)
        tolerance = _UNEVEN * (max(self.ally_rewards) - min(self.ally_rewards)) + WITHIN
        return (
            least - WITHIN <= min(self.ally_rewards)
            and max(self.ally_rewards) <= most + WITHIN
            and min(0.0, opponent.scale.reward(LOST_SCORE)) - WITHIN <= min(self.opponent_rewards)
            and self.reward("opponent") <= near + scenario.snr_drop_weight * (left + tolerance) + WITHIN
        )


def _step_bounds(scenario: Scenario) -> tuple[float, float, float] | None:
    """Return bounds of a step of an ally: the least and the greatest worth of its link, and its costs.

    The costs are a hop, spreading all the time, and the most power. None where the SNR has no cap.
    """
    costs = scenario.hop_cost + max(scenario.spread_cost_per_s) * scenario.steps_per_round
    radio = radio_record(scenario)
    if radio is not None:
        power = max(map(rotary_wing_w, scenario.ally_speed_m_s)) - radio[0]["least_power"]
        costs += float(radio[0]["flight_cost_per_w"] * power)
        return 0.0, float(radio[0]["top_utility"].max()), costs
    if scenario.snr_cap_db is None:
        return None
    threshold = scenario.snr_threshold_db
    return _LEAST_SNR_DB - threshold, scenario.snr_cap_db - threshold, costs


def read_pair(row: Row) -> Pair | None:
    """Return the pair of an untrusted row; None if it is not a pair, or of an older protocol."""
    try:
        return parse(Pair, row, "pair")
    except UserError:
        return None


def players_of_board(board: Path) -> tuple[list[CrossplayEntry], list[CrossplayEntry]]:
    """Return the verified allies and opponents of a board; see :func:`players_of`."""
    reader, cases = board_reader(board), []
    for folder in submission_folders(board):
        if folder.parent.name in SIDES:
            with contextlib.suppress(UserError, OSError):  # leaderboard verify names the problem
                cases.append(load_case(board, folder, reader=reader))
    return players_of(cases)


def players_of(cases: Iterable[Case]) -> tuple[list[CrossplayEntry], list[CrossplayEntry]]:
    """Return the allies and opponents among cases whose results are verified, scenario by scenario."""
    entries = [
        CrossplayEntry.of(case.submission, case.suites[PUBLIC], case.suites[ranked_by(case.suites)].season)
        for case in cases
        if case.result is not None and case.result.verified and case.submission.track in SIDES
    ]
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
        is_clean: true if the file holds nothing else.
    """

    allies: list[CrossplayEntry]
    opponents: list[CrossplayEntry]
    results: Mapping[Hashable, Pair]
    is_clean: bool = True

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
    store, bad = _store(board), list[str]()
    sound = store.records(bad.append)
    if bad:
        _logger.info(f"{store.path}: {len(bad)} lines are left out: not a pair, or of an older protocol")
    wanted = {each.key: each for each in Pairs(*players, {}).every()}
    own = [pair for pair in sound if pair.key in wanted and pair.is_of(*wanted[pair.key])]
    results: dict[Hashable, Pair] = {pair.key: pair for pair in own if pair.is_possible(*wanted[pair.key])}
    for pair in own:
        if pair.key not in results:
            name = wanted[pair.key].name
            _logger.warning(f"{store.path}: {name}: no rounds can earn this; it is left out")
    return Pairs(*players, results, not bad and len(results) == len(sound))


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


# Boards


def play_missing(
    board: str | Path,
    *,
    trusted: Collection[Row] | None = None,
    workers: Workers | int = 1,
) -> list[Verdict]:
    """Play the pairs of a board that have no result yet; results of entries that are gone are dropped.

    Args:
        board: the leaderboard's folder.
        trusted: trusted rows; all others are played again and replaced. None: all are trusted.
        workers: number of pairs that are played at once, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The bad verdicts: on pairs that could not be played, and on untrusted rows that did not hold.
    """
    board = Path(board)
    pairs = read_pairs(board, players_of_board(board))
    trusted_pairs = None if trusted is None else {pair for row in trusted if (pair := read_pair(row))}
    results = {
        key: pair for key, pair in pairs.results.items() if trusted_pairs is None or pair in trusted_pairs
    }
    every = pairs.every()
    missing = [each for each in every if each.key not in results]
    _logger.info(f"crossplay: {len(missing)} of {len(every)} pairs to play")
    verdicts = Verdicts(logging.DEBUG)
    with work_store(board, "crossplay", Pair) as work:
        results |= _CHECK.verify(
            missing, pairs.results, work, verdicts, trusted=trusted_pairs, workers=workers
        )
        if missing or not pairs.is_clean:
            _store(board).write([results[each.key] for each in every if each.key in results])
    return verdicts.bad()


def check_pairs(
    board: str | Path,
    share: float,
    seed: int | None = None,
    *,
    workers: Workers | int = 1,
) -> list[Verdict]:
    """Play some pairs again, drawn at random for each ally, and return the bad verdicts.

    Args:
        board: the leaderboard's folder.
        share: of each ally's pairs; at least one is played.
        seed: of the draw; None: a new one, which is logged.
        workers: as in :func:`play_missing`.

    Raises:
        UserError: a share out of range.
    """
    check_share(share)
    board, seed = Path(board), secrets.randbits(31) if seed is None else seed
    _logger.info(f"check: {100 * share:g} % of each ally's pairs, --sample-seed {seed}")
    pairs = read_pairs(board, players_of_board(board))
    there = [each for each in pairs.every() if each.key in pairs.results]
    rng, drawn = random.Random(seed), list[EntryPair]()
    for ally in pairs.allies:
        drawn += draw([each for each in there if each.ally is ally], share, rng)
    verdicts = Verdicts(logging.DEBUG)
    with work_store(board, "crossplay", Pair) as work:
        _CHECK.verify(drawn, pairs.results, work, verdicts, workers=workers)
    if not pairs.is_clean:
        line = "holds lines that no pair of this board can have; fpg-bench leaderboard crossplay removes them"
        verdicts.give(crossplay_file(board).name, False, line)
    return verdicts.bad()


def _store(board: Path) -> EncounterStore[EntryPair, Pair]:
    return EncounterStore(Pair, crossplay_file(board))


# Playing a pair


def _play(pair: EntryPair) -> Pair:
    return play_pair(*pair)


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
_CHECK = Check(_play, _compare, lambda pair, now: now.model_dump_json())


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
    rewards[lost] = min([entry.scale.reward(LOST_SCORE), *rewards[~lost]])
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
