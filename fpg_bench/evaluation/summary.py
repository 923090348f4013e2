"""From lines to what a table says: per entry the score with its interval, the worst, and the measures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.field import Field
from fpg_bench.evaluation.line import Line, Pooled, pool
from fpg_bench.evaluation.statistics import MATCHES, TRAINING_SEEDS, Interval, mean_interval


@dataclass(frozen=True)
class Summary:
    """One entry over a field.

    Attributes:
        entry: its name.
        field: what it met.
        rewards: ``(training seeds, counterparts, matches)`` returns a step; one training seed for a script.
        trained: whether the first axis is training seeds.
        lines: what it is made of, in the order of training seed and counterpart.
    """

    entry: str
    field: Field
    rewards: np.ndarray
    trained: bool
    lines: tuple[Line, ...]

    @property
    def training_seeds(self) -> int:
        """How many, 0 for a script or a planner."""
        return len(self.rewards) if self.trained else 0

    @property
    def over(self) -> str:
        """What intervals are over."""
        return TRAINING_SEEDS if self.training_seeds > 1 else MATCHES

    def units(self, rewards: np.ndarray) -> np.ndarray:
        """The units that a mean of returns a step ``(training seeds, n, matches)`` varies over."""
        axes = (1, 2) if self.training_seeds > 1 else (0, 1)
        found: np.ndarray = rewards.mean(axis=axes)
        return found

    @cached_property
    def samples(self) -> np.ndarray:
        """The score of each unit; their mean is the score."""
        found: np.ndarray = self.field.scale.score(self.units(self.rewards))
        return found

    @cached_property
    def score(self) -> Interval:
        """The score: the mean over counterparts on the track's scale, with its interval."""
        return mean_interval(self.samples, self.over)

    @cached_property
    def reward(self) -> Interval:
        """The return a step, mean over counterparts, with its interval."""
        return mean_interval(self.units(self.rewards), self.over)

    @cached_property
    def by_counterpart(self) -> dict[str, Interval]:
        """The return a step against each counterpart, with its interval."""
        return {
            counterpart.name: mean_interval(self.units(self.rewards[:, k : k + 1]), self.over)
            for k, counterpart in enumerate(self.field.counterparts)
        }

    @property
    def worst(self) -> str:
        """The name of the counterpart that it earns least against."""
        return min(self.by_counterpart, key=lambda name: self.by_counterpart[name].value)

    def seed_scores(self) -> dict[int | None, float]:
        """The score of each training seed."""
        seeds = list(dict.fromkeys(line.training_seed for line in self.lines))
        scores = self.field.scale.score(self.rewards.mean(axis=(1, 2)))
        return dict(zip(seeds, scores.tolist(), strict=True))

    @cached_property
    def pooled(self) -> Pooled:
        """The sums of all lines."""
        return pool(self.lines)

    @property
    def measures(self) -> dict[str, float | None]:
        """The measures over all rounds, both returns as means a round."""
        return self.pooled.measures


def summarise(lines: Iterable[Line], field: Field) -> list[Summary]:
    """One summary per entry whose lines are complete, best first; lines of another field are passed over."""
    found = [summary for mine in by_entry(lines, field).values() if (summary := _summary(mine, field))]
    return sorted(found, key=lambda summary: (-summary.score.value, summary.entry))


def by_entry(lines: Iterable[Line], field: Field) -> dict[str, list[Line]]:
    """The lines of a field by entry."""
    groups: dict[str, list[Line]] = {}
    for line in lines:
        if line.field_hash == field.hash[:16]:
            groups.setdefault(line.entry, []).append(line)
    return groups


def summary_of(lines: Sequence[Line], field: Field) -> Summary:
    """The summary of one entry's lines.

    Raises:
        UserError: lines are missing.
    """
    (mine,) = by_entry(lines, field).values() or [[]]
    found = _summary(mine, field)
    if found is None:
        raise UserError(
            f"field {field.name}: the lines of {mine[0].entry if mine else 'anybody'} are not whole"
        )
    return found


def _summary(lines: Sequence[Line], field: Field) -> Summary | None:
    seeds: dict[int | None, dict[str, Line]] = {}
    for line in lines:
        _check(line, field)
        seeds.setdefault(line.training_seed, {})[line.counterpart] = line
    if None in seeds and len(seeds) > 1:
        raise UserError(f"field {field.name}: {lines[0].entry} has lines with and without a training seed")
    names = [counterpart.name for counterpart in field.counterparts]
    order = sorted(seeds, key=lambda seed: seed or 0)
    whole = {seed: seeds[seed] for seed in order if set(names) <= seeds[seed].keys()}
    if not whole:
        return None
    rewards = [[field.rewards(of[name].returns) for name in names] for of in whole.values()]
    ordered = tuple(of[name] for of in whole.values() for name in names)
    return Summary(lines[0].entry, field, np.array(rewards), None not in whole, ordered)


def _check(line: Line, field: Field) -> None:
    """Raise UserError where a line cannot be of the field that it names."""
    expected = (field.rounds, field.scenario.frequency_points)
    if (len(line.returns), len(line.ally_points)) != expected:
        raise UserError(
            f"field {field.name}: the line of {line.entry} against {line.counterpart} has "
            f"{len(line.returns)} rounds, expected {field.rounds}; evaluate again into another folder"
        )
