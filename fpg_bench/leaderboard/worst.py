"""The worst that is known of an entry: the lowest over everything that ever met it, and who that was."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fpg_bench.evaluation.statistics import TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.evaluation.summary import Summary
from fpg_bench.leaderboard.tracks import PUBLIC, SHIFTED
from fpg_bench.rows import Row


@dataclass(frozen=True)
class Worst:
    """A return a step with its interval, against whom, and where they met."""

    reward: Interval
    against: str
    where: str


def worst(slug: str, side: str, summaries: Mapping[str, Summary], pairs: Iterable[Row] = ()) -> Worst:
    """The lowest return a step of an entry over all fields under its own rules, and over cross-play.

    It bounds the worst from above alone: somebody who has not met the entry may take more.

    Args:
        slug: the entry's name.
        side: ``ally``, ``opponent`` or ``planner``.
        summaries: over each field, by what it says; changed rules don't count.
        pairs: rows of cross-play.
    """
    found = [*_of_fields(summaries), *_of_pairs(slug, side, pairs)]
    return min(found, key=lambda met: met.reward.value)


def _of_fields(summaries: Mapping[str, Summary]) -> Iterator[Worst]:
    for role, summary in summaries.items():
        if role not in (SHIFTED, PUBLIC):
            name = summary.worst
            yield Worst(summary.by_counterpart[name], name, summary.field.name)


def _of_pairs(slug: str, side: str, pairs: Iterable[Row]) -> Iterator[Worst]:
    other = "opponent" if side == "ally" else "ally"
    for row in pairs:
        if row.get(side) == slug:
            reward = mean_interval(np.array(row[f"{side}_rewards"]), TRAINING_SEEDS)
            yield Worst(reward, str(row[other]), "cross-play")
