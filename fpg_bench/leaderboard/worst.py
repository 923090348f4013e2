"""The worst that is known of an entry: the lowest over everything that ever met it, and who that was."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fpg_bench.evaluation.statistics import TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.evaluation.summary import Summary
from fpg_bench.leaderboard.pairs import Pair
from fpg_bench.leaderboard.tracks import PUBLIC, SHIFTED
from fpg_bench.players.player import SIDES


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
