"""The board: all tracks with their ranked entries, and cross-play, as dataclasses that the site shows."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from pydantic import TypeAdapter

from fpg_bench.common.ids import other_side
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.statistics import (
    MATCHES,
    Interval,
    mean_interval,
    nash,
    pair_error,
    probability_of_improvement,
    student_half,
    student_t,
)
from fpg_bench.evaluation.suite import Scale
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import Standing, learning_curve, over_rounds, standings
from fpg_bench.players.planner import TIERS
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.about import SubmissionFile, board_name
from fpg_bench.products.leaderboard.cases import Case
from fpg_bench.products.leaderboard.crossplay import Pair, Pairs, fully_played, pair_key
from fpg_bench.products.leaderboard.entries import Entries
from fpg_bench.products.leaderboard.exploited import Attack, Exploited
from fpg_bench.products.leaderboard.result import PlannerFacts, round_finite
from fpg_bench.products.leaderboard.season_keys import SeasonKey
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import PUBLIC, SCENARIOS, SHIFTED, TRACKS, UNSEEN, Track, ranked_by
from fpg_bench.products.leaderboard.trail import first_returns, play_options, player_of, training_of
from fpg_bench.version import __version__

CROSSPLAY = "cross-play"
_SAME_WITHIN = 0.005  # of the range of a matrix of cross-play: one player twice
Matrix = list[list[float | None]]


@dataclass(frozen=True)
class BoardSuite:
    """A suite that the entries of a track play.

    Attributes:
        role: see :meth:`fpg_bench.products.leaderboard.tracks.TrackSuites.of`.
        rounds: against each rival, per training seed.
        rivals: their names.
        trained: how each trained rival was trained, by name.
        play: options of ``fpg-bench play`` for an entry's first round against a rival, by the rival's name;
            rivals whose game that command does not offer are left out.
    """

    role: str
    name: str
    hash: str
    rounds: int
    rivals: tuple[str, ...]
    trained: Mapping[str, str] = field(default_factory=dict)
    play: Mapping[str, str] = field(default_factory=dict)

    def label(self, rival: str) -> str:
        """Return a rival's name after the algorithm that trained it: ``TD3 o04``."""
        trained = self.trained.get(rival)
        return f"{trained.partition(',')[0]} {rival}" if trained else rival


@dataclass(frozen=True)
class PlannerFigures:
    """Figures of planners alone.

    Attributes:
        tier: what it knows, one of :data:`fpg_bench.players.planner.TIERS`.
        model: the language model, if one was recorded.
        runs: how many times it was recorded.
        season: the season after which the recording began.
        score_all: score over all rounds of a match.
        curve: score in each round of a match.
        valid, valid_but_useless: shares of the plans.
        statuses: number of plans by their status.
        tokens: per plan.
    """

    tier: str
    model: str | None
    runs: int | None
    season: int | None
    score_all: Interval
    curve: tuple[Interval, ...]
    valid: float | None
    valid_but_useless: float | None
    statuses: Mapping[str, int]
    tokens: float | None


@dataclass(frozen=True)
class Figures:
    """The figures of a verified result.

    Attributes:
        rank: best and worst rank over all pairs; None where the entry has not played the suite that ranks its
            track, and for a reference.
        may_be_best: see :func:`fpg_bench.evaluation.statistics.may_be_best`.
        behind: its score minus that of the leader, on the same matches; None without a rank.
        improvement: probability that a new training scores more than a new training of the leader; None for
            the leader, for scripts and tables, and for fewer than five training seeds.
        score: over the suite that ranks the track, else over the public one.
        scores: by role of the suite.
        exploited: its lowest known return; None for planners.
        by_rival: scores by role and rival.
        first_rounds: return of the first round of the first training seed, by role and rival.
        units: by role and rival, in the suite's order, the score in each match: a mean over training seeds.
        by_seed: scores by training seed.
        training_seeds: 0 for scripts and planners.
        is_late: entered or changed after the season was closed.
        same_policies: other entries, ``track/slug``, that play the same.
        has_few_seeds: an algorithm's training seeds are fewer than five, so that it has no rank.
        measures: over all rounds of the public suite; ``return`` is per step.
        histograms: share of time per frequency point, of the ally (``ally``) and of jamming (``jam``).
        lost, rounds: rounds lost by an invalid answer, and all rounds.
        records: one per training seed and rival.
        planner: None for players.
        fingerprint: everything that was run: versions, and hashes of suites, policies and submission.
    """

    rank: tuple[int, int] | None
    may_be_best: bool
    behind: Interval | None
    improvement: Interval | None
    score: Interval
    scores: Mapping[str, Interval]
    by_rival: Mapping[str, Mapping[str, Interval]]
    first_rounds: Mapping[str, Mapping[str, float]]
    units: Mapping[str, tuple[tuple[float, ...], ...]]
    by_seed: Mapping[int, float]
    training_seeds: int
    has_few_seeds: bool
    is_late: bool
    same_policies: tuple[str, ...]
    measures: Mapping[str, float | None]
    histograms: Mapping[str, tuple[float, ...]]
    lost: int
    rounds: int
    records: int
    planner: PlannerFigures | None
    fingerprint: Mapping[str, object]
    exploited: Exploited | None = None

    @property
    def is_reference(self) -> bool:
        """True for a planner that sees the ally's path: a bound, which is not compared with the others."""
        return self.planner is not None and self.planner.tier == TIERS[-1]

    @property
    def gap(self) -> float | None:
        """Score over the public suite minus score over the unseen suite."""
        public, unseen = self.scores.get(PUBLIC), self.scores.get(UNSEEN)
        return None if public is None or unseen is None else public.value - unseen.value


@dataclass(frozen=True)
class BoardEntry:
    """An entry of a track: the submission's own words, and its figures if it is verified.

    Attributes:
        name: its name on the board; see :func:`fpg_bench.products.leaderboard.about.board_name`.
        about: the contents of its ``submission.yaml``.
        actions: the action modes of its policies; empty if it has none.
        player: what ``fpg-bench play`` calls its script or first policy; None for planners.
        command: what trained the first seed of a zoo agent, as its card says.
        reason: why it is not verified.
        figures: None where it is not verified.
        replays: files of the rounds that its page shows.
        offline: the data sets that its policies learned from; empty if they learned by playing.
    """

    slug: str
    name: str
    about: SubmissionFile
    actions: tuple[str, ...]
    player: str | None
    command: str | None
    reason: str | None
    figures: Figures | None
    replays: tuple[str, ...] = ()
    offline: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """``script``, ``zoo`` or ``submitted``."""
        return "script" if self.about.script is not None else "zoo" if self.about.zoo else "submitted"

    @property
    def plays(self) -> str | None:
        """The script or zoo agent that it names."""
        return self.about.script or self.about.zoo


@dataclass(frozen=True)
class BoardTrack:
    """A table of the board.

    Attributes:
        ranked_by: the role of the suite that ranks it.
        scale: returns per step that score 0 and 100 in the public suite.
        checks: whether each check on the rivals held when the season was closed, by name.
        student: Student's t of the differences by role; with it those of all pairs hold together.
        entries: best first; then those without a rank, then references, then those not verified.
    """

    key: str
    title: str
    side: str
    ranked_by: str
    suites: tuple[BoardSuite, ...]
    scale: Scale
    checks: Mapping[str, bool]
    entries: tuple[BoardEntry, ...]
    student: Mapping[str, float]

    @property
    def other_side(self) -> str:
        """The side of the rivals."""
        return other_side(self.side)

    def verified(self) -> Iterator[tuple[BoardEntry, Figures]]:
        """Yield the verified entries with their figures, best first."""
        for entry in self.entries:
            if entry.figures is not None:
                yield entry, entry.figures

    @property
    def n_ranked(self) -> int:
        """Number of entries with a rank."""
        return sum(figures.rank is not None for _, figures in self.verified())


@dataclass(frozen=True)
class NashMixture:
    """Equilibrium of the zero-sum game in the ally's return per step: shares of both sides, and its value.

    It is among the entries, and no guarantee: a player that is not on the board may leave the mixture less.
    """

    ally: Mapping[str, float]
    opponent: Mapping[str, float]
    value: float


@dataclass(frozen=True)
class CrossPlay:
    """Figures of all pairs of entries of a scenario that have played all entries of the other side.

    Attributes:
        season: the number of the season on whose seeds it was played; None before the first.
        allies, opponents: rows and columns of all matrices.
        same_player: opponents that are left out, each with the opponent that is shown instead.
        missing: by side, the entries that have not played all others.
        returns: by side, mean return per step.
        half: by side, half the width of its 95 % interval over training seeds.
        rounds: per pair.
    """

    season: int | None
    allies: tuple[str, ...]
    opponents: tuple[str, ...]
    same_player: Mapping[str, str]
    missing: Mapping[str, tuple[str, ...]]
    returns: Mapping[str, Matrix]
    half: Mapping[str, Matrix]
    jamming_success_rate: Matrix
    rounds: int
    nash: NashMixture


@dataclass(frozen=True)
class Board:
    """Everything that the site shows.

    Attributes:
        season: the number of the newest closed season of ``standard``; None before the first.
        built: date of the build.
        crossplay: by scenario; without those in which no entry has played all entries of the other side.
    """

    version: str
    protocol: str
    season: int | None
    built: str
    tracks: tuple[BoardTrack, ...]
    crossplay: Mapping[str, CrossPlay]

    def names(self, side: str) -> dict[str, str]:
        """Return the entries' names by slug on a side."""
        return {
            entry.slug: entry.name for track in self.tracks if track.side == side for entry in track.entries
        }

    def to_json(self) -> str:
        """Return the board as one line of JSON."""
        return TypeAdapter(Board).dump_json(self).decode() + "\n"


def make_board(
    entries: Entries, replays: Mapping[tuple[str, str], Sequence[str]] = MappingProxyType({})
) -> Board:
    """Compute the board; figures come from results, texts from submissions.

    Args:
        entries: see :func:`fpg_bench.products.leaderboard.entries.load_entries`.
        replays: by track and entry, the files of the rounds that its page shows.
    """
    seasons = {scenario: key.number for scenario, key in entries.suites.seasons.items()}
    crossplay = {
        scenario: _make_crossplay(entries.pairs.of(scenario), seasons.get(scenario)) for scenario in SCENARIOS
    }
    return Board(
        version=__version__,
        protocol=PROTOCOL,
        season=seasons.get("standard"),
        built=datetime.datetime.now(datetime.UTC).date().isoformat(),
        tracks=tuple(_make_track(entries, track, replays) for track in TRACKS.values()),
        crossplay={scenario: played for scenario, played in crossplay.items() if played is not None},
    )


def _make_track(every: Entries, track: Track, replays: Mapping[tuple[str, str], Sequence[str]]) -> BoardTrack:
    suites, season = every.suites.of(track), every.suites.season(track)
    role = ranked_by(suites)
    verified = [item for item in every.verified if item.track is track]
    ranked = sorted(
        (item for item in verified if role in item.summaries),
        key=lambda item: (-item.summaries[role].score.value, item.slug),
    )
    ranking = [item.summaries[role] for item in ranked]
    placed = standings([item.summaries[role] for item in ranked if not _is_reference(item)])
    again = _improvements([of for of in ranking if of.entry in placed and of.has_rank])
    error = pair_error(sum(standing.rank is not None for standing in placed.values()))
    entries = [
        _make_entry(
            item.submission,
            figures=_make_figures(
                item,
                item.summaries.get(role, item.summaries[PUBLIC]),
                placed.get(item.slug),
                again.get(item.slug),
                is_late=_is_late(item.submission, season),
                exploited=_exploited(item, every),
                same_policies=tuple(every.shared.get(item.name, ())),
            ),
            replays=replays.get(item.key, ()),
        )
        for item in verified
    ]
    entries += [
        _make_entry(submission, reason=reason)
        for submission, reason in every.rejected
        if submission.board_track is track
    ]
    return BoardTrack(
        key=track.key,
        title=track.title,
        side=track.side,
        ranked_by=role,
        suites=tuple(
            BoardSuite(
                role,
                suite.name,
                suite.hash,
                suite.rounds,
                tuple(rival.name for rival in suite.rivals),
                trained={r.name: text for r in suite.rivals if (text := training_of(r))},
                play={r.name: text for r in suite.rivals if (text := play_options(suite, r))},
            )
            for role, suite in suites.items()
        ),
        scale=every.suites.public(track).scale,
        checks=_checks(season, other_side(track.side)),
        entries=tuple(sorted(entries, key=_sort_key)),
        student={
            role: student_t(suite.matches, error) for role, suite in suites.items() if suite.matches > 1
        },
    )


def _checks(season: SeasonKey | None, rivals: str) -> dict[str, bool]:
    """Return the checks of a season on the members of one side, by their names without the side."""
    checks = {} if season is None else season.checks
    named = {name.partition(": "): holds for name, holds in checks.items()}
    return {name: holds for (side, _, name), holds in named.items() if side == rivals}


def _exploited(item: Case, every: Entries) -> Exploited | None:
    """Return the lowest known return of a player over suites, cross-play and responses to it."""
    side = item.track.side
    if side not in SIDES:
        return None
    attacks = every.attacks.get(item.name, ())
    seeds = [policy.seed for policy in item.submission.policies]
    rival = lowest_rival(item.slug, side, item.summaries, every.pairs.results.values(), seeds)
    return Exploited.of(rival, attacks, seeds)


def _is_reference(item: Case) -> bool:
    planner = item.fingerprint.planner
    return planner is not None and planner.tier == TIERS[-1]


def _sort_key(entry: BoardEntry) -> tuple[int, float, str]:
    """Return the sort key of an entry: ranked ones, unranked ones, references, then those not verified."""
    figures = entry.figures
    if figures is None:
        return 3, 0.0, entry.slug
    place = 2 if figures.is_reference else int(figures.rank is None)
    return place, -figures.score.value, entry.slug


def _is_late(submission: Submission, season: SeasonKey | None) -> bool:
    """Return True if an entry came or changed after the season was closed.

    Such an entry may have trained on the season's members.
    """
    policies = [policy.sha256 for policy in submission.policies]
    name = f"{submission.track}/{submission.slug}"
    return season is not None and bool(policies) and not season.met(name, policies)


def _make_entry(
    submission: Submission,
    figures: Figures | None = None,
    reason: str | None = None,
    replays: Sequence[str] = (),
) -> BoardEntry:
    return BoardEntry(
        slug=submission.slug,
        name=board_name(submission, submission.slug),
        about=submission,
        actions=tuple(sorted({card.game.action_mode for card in submission.cards})),
        player=player_of(submission),
        command=submission.cards[0].command if submission.zoo is not None else None,
        reason=reason,
        figures=figures,
        replays=tuple(replays),
        offline=tuple(sorted({card.offline.dataset for card in submission.cards if card.offline})),
    )


def _make_figures(
    item: Case,
    ranking: Summary,
    placed: Standing | None,
    improvement: Interval | None,
    is_late: bool,
    exploited: Exploited | None,
    same_policies: tuple[str, ...],
) -> Figures:
    summaries = item.summaries
    public = summaries[PUBLIC]
    played = [record for summary in summaries.values() for record in summary.records]
    return Figures(
        rank=None if placed is None else placed.rank,
        may_be_best=placed is not None and bool(placed.may_be_best),
        behind=None if placed is None or placed.rank is None else _score(placed.behind),
        improvement=improvement,
        score=_score(ranking.score),
        scores={role: _score(summary.score) for role, summary in summaries.items()},
        by_rival={
            role: {name: _score(interval, summary.suite.scale) for name, interval in summary.by_rival.items()}
            for role, summary in summaries.items()
        },
        first_rounds={role: first_returns(summary.records) for role, summary in summaries.items()},
        units={role: _make_units(summary) for role, summary in summaries.items()},
        by_seed={
            seed: round_finite(score) for seed, score in ranking.seed_scores().items() if seed is not None
        },
        training_seeds=public.training_seeds,
        has_few_seeds=not public.has_rank,
        is_late=is_late,
        same_policies=same_policies,
        measures={"return": public.reward.value, **public.measures},
        histograms={
            side: tuple(round_finite(share) for share in counts / max(counts.sum(), 1))
            for side, counts in zip(("ally", "jam"), public.pooled.histogram, strict=True)
        },
        lost=sum(record.lost for record in played),
        rounds=sum(len(record.returns) for record in played),
        records=len(played),
        planner=_make_planner_figures(public, item.fingerprint.planner),
        fingerprint={} if item.result is None else item.result.fingerprint.to_dict(),
        exploited=exploited,
    )


def _make_units(summary: Summary) -> tuple[tuple[float, ...], ...]:
    by_rival = np.round(summary.suite.scale.score(summary.rewards.mean(axis=0)), 2)
    return tuple(map(tuple, by_rival.tolist()))


def _make_planner_figures(public: Summary, facts: PlannerFacts | None) -> PlannerFigures | None:
    plans = public.pooled.plans
    if plans is None or facts is None:
        return None
    return PlannerFigures(
        tier=facts.tier,
        model=facts.model,
        runs=facts.runs,
        season=facts.season,
        score_all=_score(over_rounds(public, slice(None))),
        curve=tuple(map(_score, learning_curve(public))),
        valid=plans.valid,
        valid_but_useless=plans.valid_but_useless,
        statuses=plans.statuses,
        tokens=None if plans.tokens is None else plans.tokens / sum(plans.statuses.values()),
    )


def lowest_rival(
    slug: str,
    side: str,
    summaries: Mapping[str, Summary],
    pairs: Iterable[Pair] = (),
    seeds: Sequence[int] = (),
) -> Attack:
    """Return the lowest return per step of a single training seed, over suites and cross-play.

    Args:
        slug: the entry's slug.
        side: ``ally`` or ``opponent``.
        summaries: by role of the suite; changed rules do not count.
        pairs: results of cross-play.
        seeds: the entry's training seeds, in their order; none of a script.
    """
    met = [
        (rewards, rival.name, role)
        for role, summary in summaries.items()
        if role != SHIFTED
        for rewards, rival in zip(summary.rewards.swapaxes(0, 1), summary.suite.rivals, strict=True)
    ]
    other = other_side(side)
    met += [
        (np.array(pair.rewards(side))[:, None], getattr(pair, other), CROSSPLAY)
        for pair in pairs
        if getattr(pair, side) == slug
    ]
    rewards, rival, where = min(met, key=lambda case: float(case[0].mean(axis=1).min()))
    lowest = int(rewards.mean(axis=1).argmin())
    interval = _score(mean_interval(rewards[lowest], MATCHES))
    return Attack(rival, where, interval, seeds[lowest] if seeds else None)


def _score(interval: Interval, scale: Scale | None = None) -> Interval:
    """Return a rounded interval; a scale converts it from a return per step to a score."""
    value, low, high = (
        round_finite(end if scale is None else scale.score(end))
        for end in (interval.value, interval.low, interval.high)
    )
    return Interval(value, low, high, interval.over)


def _improvements(ranked: Sequence[Summary]) -> dict[str, Interval]:
    """Return the probability that a new training of an entry scores more than one of the leader."""
    seeds = {summary.entry: summary.samples.mean(axis=1) for summary in ranked}
    if not ranked:
        return {}
    leader, *others = ranked
    is_fixed = not leader.trained or leader.training.is_search
    best = seeds[leader.entry].mean(keepdims=True) if is_fixed else seeds[leader.entry]
    return {
        of.entry: _score(probability_of_improvement(seeds[of.entry], best))
        for of in others
        if of.trained and not of.training.is_search
    }


def _make_crossplay(pairs: Pairs, season: int | None) -> CrossPlay | None:
    allies, opponents = fully_played(pairs)
    if not allies or not opponents:
        return None
    played = [[pairs.results[pair_key(a, o)] for o in opponents] for a in allies]
    returns = {side: [[round_finite(pair.reward(side)) for pair in row] for row in played] for side in SIDES}
    half = {side: [[_half_width(pair, side) for pair in row] for row in played] for side in SIDES}
    jammed = [[pair.jamming_success_rate for pair in row] for row in played]
    equilibrium = nash(-np.array(returns["ally"]))  # the ally, who chooses rows, minimises
    left_out = _same_players(
        [entry.identity for entry in opponents], [*map(np.array, returns.values()), np.array(jammed)]
    )
    shown = [column for column in range(len(opponents)) if column not in left_out]
    slugs = [entry.slug for entry in opponents]
    shares = dict.fromkeys((slugs[column] for column in shown), 0.0)
    for column, share in enumerate(equilibrium.columns):  # a player has the shares of all its entries
        shares[slugs[left_out.get(column, column)]] += round_finite(share)

    def columns(matrix: Sequence[Sequence[float | None]]) -> Matrix:
        return [[row[column] for column in shown] for row in matrix]

    return CrossPlay(
        season=season,
        allies=tuple(entry.slug for entry in allies),
        opponents=tuple(shares),
        same_player={slugs[column]: slugs[first] for column, first in left_out.items()},
        missing={
            side: tuple(entry.slug for entry in entries if entry not in complete)
            for side, entries, complete in (
                ("ally", pairs.allies, allies),
                ("opponent", pairs.opponents, opponents),
            )
        },
        returns={side: columns(matrix) for side, matrix in returns.items()},
        half={side: columns(matrix) for side, matrix in half.items()},
        jamming_success_rate=columns(jammed),
        rounds=played[0][0].rounds,
        nash=NashMixture(
            ally={a.slug: round_finite(share) for a, share in zip(allies, equilibrium.rows, strict=True)},
            opponent=shares,
            value=round_finite(-equilibrium.value),
        ),
    )


def _half_width(pair: Pair, side: str) -> float | None:
    """Return half the width of the 95 % interval of a side's return per step; None for a single seed."""
    rewards = np.array(pair.rewards(side))
    return round_finite(student_half(rewards)) if len(rewards) > 1 else None


def _same_players(identities: Sequence[list[str]], matrices: Sequence[np.ndarray]) -> dict[int, int]:
    """Return the columns that repeat an earlier one: the same policies with the same figures everywhere.

    Figures are compared, too, because the same policies play a different game in the table of opponents that
    fly themselves.
    """
    first: dict[int, int] = {}
    for column, identity in enumerate(identities):
        for earlier in range(column):
            is_same = identity == identities[earlier] and earlier not in first
            if is_same and all(_is_close(matrix, column, earlier) for matrix in matrices):
                first[column] = earlier
                break
    return first


def _is_close(matrix: np.ndarray, one: int, other: int) -> bool:
    return bool(np.abs(matrix[:, one] - matrix[:, other]).max() <= _SAME_WITHIN * np.ptp(matrix))
