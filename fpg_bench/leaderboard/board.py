"""The board: all that the site shows, as one structure that is ready for JSON."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import nearest
from fpg_bench.evaluation.columns import learning_curve, over_rounds
from fpg_bench.evaluation.field import Field
from fpg_bench.evaluation.seeds import PROTOCOL, current_season
from fpg_bench.evaluation.statistics import FEW_SEEDS, Interval, rank_ranges
from fpg_bench.evaluation.summary import Summary
from fpg_bench.jobs.job import outcome_of
from fpg_bench.leaderboard.cases import Case, case_of, entered, result_file, submission_folders
from fpg_bench.leaderboard.fields import TRACKS as FOLDERS
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.nash import nash
from fpg_bench.leaderboard.pairs import (
    BoardEntry,
    Pair,
    Pairs,
    fully_played,
    pair_key,
    players_of,
    read_pairs,
)
from fpg_bench.leaderboard.ranking import improvements, profiles
from fpg_bench.leaderboard.result import Result, rounded
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.leaderboard.tracks import KNOWN, PUBLIC, TRACKS, Track, ranked_by
from fpg_bench.leaderboard.worst import Worst, worst
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row
from fpg_bench.version import __version__

_LONGEST_REASON = 300
# By how many points a score on the seeds that everybody knew may lie above that on the season's, beyond what
# the track's entries gain there in the middle.
SEEDS_GAP = 5.0


@dataclass(frozen=True)
class _Scored:
    """A verified submission: its case and result, and its summaries by what they say.

    Attributes:
        ranking: what ranks it; None where it has not played what its track is ranked by.
    """

    case: Case
    result: Result
    summaries: Mapping[str, Summary]
    ranking: Summary | None


def make_board(folder: str | Path = "leaderboard", say: Callable[[str], None] = lambda line: None) -> Row:
    """Everything that the site shows: tables with ranks, and cross-play.

    Figures come from results alone, texts from what was submitted. A submission whose result is missing is
    left out; one whose result does not fit it is shown as not verified.

    Args:
        folder: the leaderboard's.
        say: told a line per submission that is left out or not verified, and why.

    Raises:
        UserError: no such folder, or a file of it that can't be read as what it is.
    """
    folder = Path(folder)
    shown, season = _shown(folder, say), current_season()
    cases = [case for _, case, _ in shown if case is not None]
    pairs = read_pairs(folder, players_of(cases), say=say)
    return {
        "version": __version__,
        "protocol": PROTOCOL,
        "season": None if season is None else season.number,
        "built": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "tracks": [_table(shown, track, list(pairs.known.values())) for track in TRACKS.values()],
        "crossplay": _crossplay(pairs),
    }


def _shown(board: Path, say: Callable[[str], None]) -> list[tuple[Submission, Case | None, str | None]]:
    """Every readable submission that has a result: its case, or why the result does not count."""
    found: list[tuple[Submission, Case | None, str | None]] = []
    for path in sorted((board / "submissions").glob("[!.]*/")):
        if path.name not in FOLDERS:
            say(f"submissions/{path.name}: left out: is no track{nearest(path.name, FOLDERS)}")
    for folder in submission_folders(board):
        name = f"{folder.parent.name}/{folder.name}"
        if not result_file(board, folder.parent.name, folder.name).exists():
            say(f"{name}: left out: has no result; make it: fpg-bench submit run {brief(folder)}")
            continue
        read = outcome_of(partial(entered, board, folder, contract=False))
        if read.error is not None:
            say(f"{name}: left out: {read.error}")  # nothing of it can be trusted, not even its name
            continue
        submission: Submission = read.result
        case, why = _case(board, submission)
        found.append((submission, case, why))
        if why is not None:
            say(f"{name}: not verified: {why}")
    return found


def _case(board: Path, submission: Submission) -> tuple[Case | None, str | None]:
    """The case of a submission whose result counts; None, and why it does not, of any other."""
    read = outcome_of(partial(case_of, board, submission))
    if read.error is not None:
        return None, read.error
    case: Case = read.result
    if case.known is None or case.known.verified:
        return case, None
    return None, "".join(c if c.isprintable() else " " for c in case.known.head["reason"][:_LONGEST_REASON])


def _table(shown: Iterable[Any], track: Track, pairs: list[Pair]) -> Row:
    """One table: its rows from best to worst, those that are not ranked or not verified last."""
    fields = track.fields()
    mine = [item for item in shown if (item[0].track, item[0].path) == (track.side, track.path)]
    scored = [
        _scored(case, case.known, ranked_by(fields))
        for _, case, _ in mine
        if case is not None and case.known is not None and case.known.verified
    ]
    scored.sort(key=_place)
    ranked = [entry for entry in scored if entry.ranking is not None]
    ranking = [entry.ranking for entry in ranked if entry.ranking is not None]
    ranks = rank_ranges([summary.samples for summary in ranking])
    by_slug = {entry.result.slug: rank for entry, rank in zip(ranked, ranks, strict=True)}
    gaps = _seeds_gaps(scored)
    rows = [
        _texts(entry.case.submission)
        | _figures(entry, worst(entry.result.slug, track.side, entry.summaries, pairs))
        | {"rank": list(by_slug[slug]) if (slug := entry.result.slug) in by_slug else None}
        | {"seeds_gap": gaps.get(slug), "had_access": _had_access(entry.case.submission)}
        for entry in scored
    ]
    rows += [_texts(submission) | _blank(why) for submission, _, why in mine if why is not None]
    return {
        "key": track.key,
        "title": track.title,
        "side": track.side,
        "ranked_by": ranked_by(fields),
        "fields": [_told_field(role, field) for role, field in fields.items()],
        "scale": {"zero": track.field.scale.zero, "top": track.field.scale.top},
        "rows": rows,
        "improvement": _improvement(ranking),
        "profiles": _profiles(ranking),
    }


def _had_access(submission: Submission) -> bool:
    """Whether it was entered, or changed, after the season was closed: it may have trained on its members."""
    season = current_season()
    name, policies = f"{submission.track}/{submission.slug}", [p.sha256 for p in submission.policies]
    return season is not None and bool(policies) and not season.met(name, policies)


def _scored(case: Case, result: Result, role: str) -> _Scored:
    summaries = result.summaries(case.fields)
    return _Scored(case, result, summaries, summaries.get(role))


def _place(entry: _Scored) -> tuple[bool, float, str]:
    ranking = entry.ranking or entry.summaries[KNOWN]
    return entry.ranking is None, -ranking.score.value, entry.result.slug


def _told_field(role: str, field: Field) -> Row:
    names = [counterpart.name for counterpart in field.counterparts]
    return {
        "role": role,
        "name": field.name,
        "hash": field.hash,
        "rounds": field.rounds,
        "counterparts": names,
    }


def _seeds_gaps(scored: Sequence[_Scored]) -> dict[str, Row]:
    """By how much each scores more on seeds that everybody knew than others do, and whether that is flagged:
    where it is more than a few points, and more than chance.
    """
    gaps = {
        entry.result.slug: _gap(entry.summaries[PUBLIC], entry.summaries[KNOWN])
        for entry in scored
        if PUBLIC in entry.summaries
    }
    middle = float(np.median([value for value, _ in gaps.values()])) if gaps else 0.0
    return {
        slug: {"value": _short(value - middle), "flagged": value - middle > SEEDS_GAP and low > middle}
        for slug, (value, low) in gaps.items()
    }


def _gap(public: Summary, known: Summary) -> tuple[float, float]:
    """How much more a score is on the one field's seeds, and the lower end of its interval over matches."""
    from scipy.stats import ttest_ind

    ours, theirs = (of.field.scale.score(of.rewards.mean(axis=(0, 1))) for of in (public, known))
    with np.errstate(divide="ignore", invalid="ignore"):  # a single match has no spread
        interval = ttest_ind(ours, theirs, equal_var=False).confidence_interval()
    return float(ours.mean() - theirs.mean()), float(interval.low)


def _texts(submission: Submission) -> Row:
    """What a submission says of itself."""
    kind = "script" if submission.script is not None else "zoo" if submission.zoo is not None else "submitted"
    training = submission.training
    return {
        "slug": submission.slug,
        "name": submission.name,
        "authors": list(submission.authors),
        "algorithm": submission.algorithm,
        "reference": submission.reference,
        "licence": submission.licence,
        "kind": kind,
        "training": None if training is None else {**asdict(training), "seeds": list(training.seeds)},
        "saw": submission.saw,
        "unable": submission.unable,
        "description": submission.description,
        "replays": [],
    }


def _figures(entry: _Scored, lowest: Worst) -> Row:
    """What a verified result says."""
    result, known = entry.result, entry.summaries[KNOWN]
    ranking, scale = entry.ranking or known, known.field.scale
    lines = [line for summary in entry.summaries.values() for line in summary.lines]
    return {
        "status": result.head["status"],
        "reason": None,
        "training_seeds": known.training_seeds,
        "few_seeds": 0 < known.training_seeds < FEW_SEEDS,
        "score": _interval(ranking.score) | {"over": ranking.over},
        "scores": {role: _interval(of.score) | {"over": of.over} for role, of in entry.summaries.items()},
        "worst": {
            "against": lowest.against,
            "where": lowest.where,
            "return": _interval(lowest.reward),
            **{end: _short(scale.score(getattr(lowest.reward, end))) for end in ("value", "low", "high")},
        },
        "counterparts": {
            role: {name: _scaled(met, of) for name, met in of.by_counterpart.items()}
            for role, of in entry.summaries.items()
        },
        "seeds": {str(seed): _short(x) for seed, x in ranking.seed_scores().items() if seed is not None},
        "measures": {"return": known.reward.value, **known.measures},
        "lost": sum(line.lost for line in lines),
        "rounds": sum(len(line.returns) for line in lines),
        "planner": _planner(known, result),
        "histograms": {
            side: [_short(share) for share in of / max(of.sum(), 1)]
            for side, of in zip(("ally", "jam"), known.pooled.histogram, strict=True)
        },
        "fingerprint": result.fingerprint,
    }


def _scaled(reward: Interval, summary: Summary) -> Row:
    """A return a step as a score."""
    scale = summary.field.scale
    return {name: _short(scale.score(getattr(reward, name))) for name in ("value", "low", "high")}


def _planner(known: Summary, result: Result) -> Row | None:
    """What is told of planners alone: what they know, how they learn, and how a language model answered."""
    plans = known.pooled.plans
    if plans is None:
        return None
    count = sum(plans.statuses.values())
    return {
        **result.fingerprint["planner"],
        "score_all": _interval(over_rounds(known, slice(None))),
        "curve": [_interval(of) for of in learning_curve(known)],
        "valid": plans.valid,
        "statuses": plans.statuses,
        "tokens": None if plans.tokens is None else plans.tokens / count,
    }


def _blank(why: str) -> Row:
    """What is shown of a result that is not verified, or does not count."""
    empty: Row = dict.fromkeys(
        ("rank", "score", "worst", "planner", "histograms", "fingerprint", "seeds_gap", "had_access")
    )
    return empty | {
        "status": "not verified",
        "reason": why,
        "training_seeds": 0,
        "few_seeds": False,
        "scores": {},
        "counterparts": {},
        "seeds": {},
        "measures": {},
        "lost": 0,
        "rounds": 0,
    }


def _improvement(standings: Sequence[Summary]) -> Row:
    table = improvements(standings)

    def each(name: str) -> list[list[float | None]]:
        return [[None if cell is None else _short(getattr(cell, name)) for cell in row] for row in table]

    names = [entry.entry for entry in standings]
    return {"names": names, "value": each("value"), "low": each("low"), "high": each("high")}


def _profiles(standings: Sequence[Summary]) -> Row:
    thresholds, shares = profiles(standings)
    return {
        "thresholds": [_short(value) for value in thresholds],
        "share": {
            entry.entry: [_short(value) for value in row]
            for entry, row in zip(standings, shares, strict=True)
        },
    }


def _crossplay(pairs: Pairs) -> Row | None:
    """The matrices of those who have all played each other, and the Nash mixtures of the ally's return.

    None where nobody has.
    """
    allies, opponents = fully_played(pairs)
    if not allies or not opponents:
        return None
    played = [[pairs.known[pair_key(a, o, pairs.rounds)] for o in opponents] for a in allies]
    returns = {side: [[_short(pair.reward(side)) for pair in line] for line in played] for side in SIDES}
    found = nash(-np.array(returns["ally"]))  # the ally, who chooses rows, minimises
    return {
        "allies": [a.slug for a in allies],
        "opponents": [o.slug for o in opponents],
        "missing": {
            side: [entry.slug for entry in every if entry not in shown]
            for side, every, shown in (
                ("ally", pairs.allies, allies),
                ("opponent", pairs.opponents, opponents),
            )
        },
        "twins": _twins(opponents, returns["ally"]),
        "returns": returns,
        "jamming_success_rate": [[pair.jamming_success_rate for pair in line] for line in played],
        "rounds": pairs.rounds,
        "nash": {
            "ally": {a.slug: _short(p) for a, p in zip(allies, found.rows, strict=True)},
            "opponent": {o.slug: _short(p) for o, p in zip(opponents, found.columns, strict=True)},
            "value": _short(-found.value),
        },
    }


def _twins(entries: Sequence[BoardEntry], returns: Sequence[Sequence[float | None]]) -> list[list[str]]:
    """Entries that are one player in two tables and fare alike, each group once.

    Args:
        entries: who stands in the columns.
        returns: ``(allies, entries)``, the allies' return a step, another where a player flies otherwise.
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for entry, column in zip(entries, zip(*returns, strict=True), strict=True):
        alike = (*entry.identity, *(f"{value:.2f}" for value in column))
        groups.setdefault(alike, []).append(entry.slug)
    return [slugs for slugs in groups.values() if len(slugs) > 1]


def _interval(interval: Interval) -> Row:
    return {name: _short(getattr(interval, name)) for name in ("value", "low", "high")}


def _short(value: Any) -> float | None:
    return rounded(float(value))
