"""Summaries of records: per entry the score with its interval, the worst rival, and the measures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ORACLES
from fpg_bench.evaluation.record import Pooled, Record, pool
from fpg_bench.evaluation.statistics import ENOUGH_SEEDS, MATCHES, Interval, mean_interval
from fpg_bench.evaluation.suite import Suite


@dataclass(frozen=True)
class TrainingCost:
    """Cost of the training of an entry's agents; None for all else, and where it is unknown.

    Attributes:
        steps: mean number of steps that were played, over the training seeds.
        seconds: mean wall time over the training seeds, without evaluations.
        elsewhere: True if the training had other rules than the suite.
        is_search: True for tables found by search; a further search is no other sample of an algorithm.
    """

    steps: int | None = None
    seconds: float | None = None
    elsewhere: bool = False
    is_search: bool = False


@dataclass(frozen=True)
class Summary:
    """Results of one entry on a suite.

    Attributes:
        entry: its name.
        suite: the suite.
        rewards: ``(training seeds, rivals, matches)`` rewards per step; one training seed for a script.
        trained: true if the first axis is training seeds.
        records: the records that it summarises, in the order of training seed and rival.
        training: cost of the training of agents.
        played: time from which records of a player of code, or against rivals of code, are; None for others.
    """

    entry: str
    suite: Suite
    rewards: np.ndarray
    trained: bool
    records: tuple[Record, ...]
    training: TrainingCost = TrainingCost()
    played: str | None = None

    def __repr__(self) -> str:
        return f"Summary({self.entry!r}, {self.suite.name!r}, score={self.score.value:.1f})"

    @property
    def is_oracle(self) -> bool:
        """True for a player that sees the full state, which no table ranks."""
        return self.entry in ORACLES

    @property
    def label(self) -> str:
        """Its name in tables."""
        return f"{self.entry} (full state)" if self.is_oracle else self.entry

    @property
    def training_seeds(self) -> int:
        """Number of training seeds; 0 for a script or a planner."""
        return len(self.rewards) if self.trained else 0

    @property
    def has_rank(self) -> bool:
        """False for an oracle, and for an algorithm of fewer than five training seeds."""
        is_sampled = self.trained and not self.training.is_search
        return not self.is_oracle and not (is_sampled and len(self.rewards) < ENOUGH_SEEDS)

    @cached_property
    def samples(self) -> np.ndarray:
        """The score of each training seed in each match, ``(training seeds, matches)``."""
        return self.suite.scale.score(self.rewards.mean(axis=1))

    @cached_property
    def score(self) -> Interval:
        """The score: the mean over rivals on the suite's scale, with its interval over matches."""
        return mean_interval(self.samples.mean(axis=0), MATCHES)

    @cached_property
    def reward(self) -> Interval:
        """The reward per step, mean over rivals, with its interval."""
        return mean_interval(self.rewards.mean(axis=(0, 1)), MATCHES)

    @cached_property
    def by_rival(self) -> dict[str, Interval]:
        """The reward per step against each rival, with its interval."""
        rewards = zip(self.suite.rivals, self.rewards.mean(axis=0), strict=True)
        return {rival.name: mean_interval(of, MATCHES) for rival, of in rewards}

    @property
    def worst(self) -> str:
        """The name of the rival that it earns least against."""
        return min(self.by_rival, key=lambda name: self.by_rival[name].value)

    def seed_scores(self) -> dict[int | None, float]:
        """Return the score of each training seed."""
        seeds = list(dict.fromkeys(record.training_seed for record in self.records))
        scores = self.suite.scale.score(self.rewards.mean(axis=(1, 2)))
        return dict(zip(seeds, scores.tolist(), strict=True))

    @cached_property
    def pooled(self) -> Pooled:
        """The sums of all records."""
        return pool(self.records)

    @cached_property
    def measures(self) -> dict[str, float | None]:
        """The measures over all rounds, both returns as means per round."""
        return self.pooled.measures


def summarise(records: Iterable[Record], suite: Suite) -> list[Summary]:
    """Return one summary per entry with complete records; other suites' records are skipped.

    The best comes first, oracles last.
    """
    summaries = [_summary(of_entry, suite) for of_entry in by_entry(records, suite).values()]
    return sorted(filter(None, summaries), key=lambda s: (s.is_oracle, -s.score.value, s.entry))


def by_entry(records: Iterable[Record], suite: Suite) -> dict[str, list[Record]]:
    """Return the records of a suite by entry."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        if record.suite_hash == suite.hash[:16]:
            groups.setdefault(record.entry, []).append(record)
    return groups


def summary_of(records: Sequence[Record], suite: Suite) -> Summary:
    """Return the summary of one entry's records.

    Raises:
        UserError: records are missing.
    """
    (of_entry,) = by_entry(records, suite).values() or [[]]
    summary = _summary(of_entry, suite)
    if summary is None:
        whose = f" of {of_entry[0].entry}" if of_entry else ""
        raise UserError(f"suite {suite.name}: records{whose} are missing")
    return summary


def _summary(records: Sequence[Record], suite: Suite) -> Summary | None:
    seeds: dict[int | None, dict[str, Record]] = {}
    for record in records:
        _check(record, suite)
        seeds.setdefault(record.training_seed, {})[record.rival] = record
    if None in seeds and len(seeds) > 1:
        raise UserError(
            f"suite {suite.name}: {records[0].entry} has records with and without a training seed"
        )
    names = [rival.name for rival in suite.rivals]
    order = sorted(seeds, key=lambda seed: seed or 0)
    complete = {seed: seeds[seed] for seed in order if set(names) <= seeds[seed].keys()}
    if not complete:
        return None
    rewards = [[suite.rewards(of[name].returns) for name in names] for of in complete.values()]
    ordered = tuple(of[name] for of in complete.values() for name in names)
    return Summary(records[0].entry, suite, np.array(rewards), None not in complete, ordered)


def _check(record: Record, suite: Suite) -> None:
    """Refuse a record that cannot be of the suite that it names."""
    expected = (suite.rounds, suite.scenario.frequency_points)
    if (len(record.returns), len(record.ally_points)) != expected:
        raise UserError(
            f"suite {suite.name}: the record of {record.entry} against {record.rival} has "
            f"{len(record.returns)} rounds, expected {suite.rounds}; evaluate again into another folder"
        )
