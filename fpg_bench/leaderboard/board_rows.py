"""An entry's row of a board's table: what it says of itself, and what its verified result says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fpg_bench.evaluation.field import Field, Scale
from fpg_bench.evaluation.seeds import current_season
from fpg_bench.evaluation.statistics import FEW_SEEDS, TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import learning_curve, over_rounds
from fpg_bench.leaderboard.cases import Case
from fpg_bench.leaderboard.pairs import Pair
from fpg_bench.leaderboard.result import Result, interval_row, rounded
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.leaderboard.tracks import KNOWN, PUBLIC, SHIFTED
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row

# By how many points a score on the seeds that everybody knew may lie above that on the season's, beyond what
# the track's entries gain there in the middle.
SEEDS_GAP = 5.0


@dataclass(frozen=True)
class Scored:
    """A verified submission: its case and result, and its summaries by what they say.

    Attributes:
        ranking: what ranks it; None where it has not played what its track is ranked by.
    """

    case: Case
    result: Result
    summaries: Mapping[str, Summary]
    ranking: Summary | None


def had_access(submission: Submission) -> bool:
    """Whether it was entered, or changed, after the season was closed: it may have trained on its members."""
    season = current_season()
    name, policies = f"{submission.track}/{submission.slug}", [p.sha256 for p in submission.policies]
    return season is not None and bool(policies) and not season.met(name, policies)


def scored(case: Case, result: Result, role: str) -> Scored:
    """A verified submission with its summaries; ``role`` is what ranks its track."""
    summaries = result.summaries(case.fields)
    return Scored(case, result, summaries, summaries.get(role))


def place(entry: Scored) -> tuple[bool, float, str]:
    """What a table is sorted by: who is ranked first, then by score."""
    ranking = entry.ranking or entry.summaries[KNOWN]
    return entry.ranking is None, -ranking.score.value, entry.result.slug


def told_field(role: str, field: Field) -> Row:
    """What a table says of a field that its entries play."""
    names = [counterpart.name for counterpart in field.counterparts]
    return {
        "role": role,
        "name": field.name,
        "hash": field.hash,
        "rounds": field.rounds,
        "counterparts": names,
    }


def seeds_gaps(scored: Sequence[Scored]) -> dict[str, Row]:
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
        slug: {"value": short(value - middle), "flagged": value - middle > SEEDS_GAP and low > middle}
        for slug, (value, low) in gaps.items()
    }


def _gap(public: Summary, known: Summary) -> tuple[float, float]:
    """How much more a score is on the one field's seeds, and the lower end of its interval over matches."""
    from scipy.stats import ttest_ind

    ours, theirs = (of.field.scale.score(of.rewards.mean(axis=(0, 1))) for of in (public, known))
    with np.errstate(divide="ignore", invalid="ignore"):  # a single match has no spread
        interval = ttest_ind(ours, theirs, equal_var=False).confidence_interval()
    return float(ours.mean() - theirs.mean()), float(interval.low)


def texts(submission: Submission) -> Row:
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
        "plays": submission.script or submission.zoo,
        "training": None if training is None else {**asdict(training), "seeds": list(training.seeds)},
        "saw": submission.saw,
        "unable": submission.unable,
        "description": submission.description,
        "replays": [],
    }


def figures(entry: Scored, lowest: Worst) -> Row:
    """What a verified result says."""
    result, known = entry.result, entry.summaries[KNOWN]
    ranking, scale = entry.ranking or known, known.field.scale
    lines = [line for summary in entry.summaries.values() for line in summary.lines]
    return {
        "status": result.head["status"],
        "reason": None,
        "training_seeds": known.training_seeds,
        "few_seeds": 0 < known.training_seeds < FEW_SEEDS,
        "score": interval_row(ranking.score) | {"over": ranking.over},
        "scores": {role: interval_row(of.score) | {"over": of.over} for role, of in entry.summaries.items()},
        "worst": {
            "against": lowest.against,
            "where": lowest.where,
            "return": interval_row(lowest.reward),
            **_scaled(lowest.reward, scale),
        },
        "counterparts": {
            role: {name: _scaled(met, of.field.scale) for name, met in of.by_counterpart.items()}
            for role, of in entry.summaries.items()
        },
        "units": {
            role: {"over": of.over, "scores": _units(of)}
            for role, of in entry.summaries.items()
            if role != PUBLIC
        },
        "seeds": {str(seed): short(x) for seed, x in ranking.seed_scores().items() if seed is not None},
        "measures": {"return": known.reward.value, **known.measures},
        "lost": sum(line.lost for line in lines),
        "rounds": sum(len(line.returns) for line in lines),
        "planner": _planner(known, result),
        "histograms": {
            side: [short(share) for share in of / max(of.sum(), 1)]
            for side, of in zip(("ally", "jam"), known.pooled.histogram, strict=True)
        },
        "fingerprint": result.fingerprint,
    }


def _units(summary: Summary) -> list[list[float]]:
    """Per counterpart, in the field's order, the scores that its interval is over."""
    every = [summary.units(summary.rewards[:, k : k + 1]) for k in range(summary.rewards.shape[1])]
    return [np.round(summary.field.scale.score(of), 1).tolist() for of in every]


def _scaled(reward: Interval, scale: Scale) -> Row:
    """A return a step as a score."""
    return {name: short(scale.score(getattr(reward, name))) for name in ("value", "low", "high")}


def _planner(known: Summary, result: Result) -> Row | None:
    """What is told of planners alone: what they know, how they learn, and how a language model answered."""
    plans = known.pooled.plans
    if plans is None:
        return None
    count = sum(plans.statuses.values())
    return {
        **result.fingerprint["planner"],
        "score_all": interval_row(over_rounds(known, slice(None))),
        "curve": [interval_row(of) for of in learning_curve(known)],
        "valid": plans.valid,
        "valid_but_useless": plans.valid_but_useless,
        "statuses": plans.statuses,
        "tokens": None if plans.tokens is None else plans.tokens / count,
    }


def blank(why: str) -> Row:
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
        "units": {},
        "seeds": {},
        "measures": {},
        "lost": 0,
        "rounds": 0,
    }


def short(value: Any) -> float | None:
    """A number of a board, to the digits that count; None where it is none."""
    return rounded(float(value))


@dataclass(frozen=True)
class Worst:
    """A return a step with its interval, against whom, and where they met."""

    reward: Interval
    against: str
    where: str


def worst(slug: str, side: str, summaries: Mapping[str, Summary], pairs: Iterable[Pair] = ()) -> Worst:
    """The lowest return a step of an entry over all fields under its own rules, and over cross-play.

    It bounds the worst from above alone: somebody who has not met the entry may take more.

    Args:
        slug: the entry's name.
        side: ``ally``, ``opponent`` or ``planner``.
        summaries: over each field, by what it says; changed rules don't count.
        pairs: of cross-play.
    """
    found = [*_of_fields(summaries), *_of_pairs(slug, side, pairs)]
    return min(found, key=lambda met: met.reward.value)


def _of_fields(summaries: Mapping[str, Summary]) -> Iterator[Worst]:
    for role, summary in summaries.items():
        if role not in (SHIFTED, PUBLIC):
            name = summary.worst
            yield Worst(summary.by_counterpart[name], name, summary.field.name)


def _of_pairs(slug: str, side: str, pairs: Iterable[Pair]) -> Iterator[Worst]:
    other = "opponent" if side == "ally" else "ally"
    for pair in pairs:
        if side in SIDES and getattr(pair, side) == slug:
            reward = mean_interval(np.array(pair.rewards(side)), TRAINING_SEEDS)
            yield Worst(reward, getattr(pair, other), "cross-play")
