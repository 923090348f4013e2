"""Who is ahead of whom, and how sure that is: leads, shared ranks, improvement, profiles."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fpg_bench.evaluation.panel import Panel
from fpg_bench.evaluation.profiles import performance_profile, probability_of_improvement
from fpg_bench.evaluation.statistics import (
    BOOTSTRAPS,
    FEW_SEEDS,
    SEEDS_FOR_BOOTSTRAP,
    Interval,
    iqm,
    iqm_interval,
    resampled,
    student_t,
)
from fpg_bench.evaluation.zoo_scores import score_arrays
from fpg_bench.leaderboard.result import Result

_THRESHOLDS = 81  # of a profile
_NORMAL = 1.95996


@dataclass(frozen=True)
class Standing:
    """One entry of a table that is ranked.

    Attributes:
        slug: its name in the track.
        scores: ``(training seeds, entries, matches)`` normalised scores; one training seed for a script.
        trained: whether the first axis is training seeds.
    """

    slug: str
    scores: np.ndarray
    trained: bool

    @property
    def seeds(self) -> int:
        """How many units its interval over training seeds has; 0 where that has none."""
        return len(self.scores) if self.trained and len(self.scores) > 1 else 0

    @property
    def few(self) -> bool:
        """Whether it has so few training seeds that their spread is hardly known."""
        return self.trained and len(self.scores) < FEW_SEEDS

    @cached_property
    def per_seed(self) -> np.ndarray:
        """``(training seeds,)`` IQM over entries."""
        return iqm(self.scores.mean(axis=2))

    @property
    def value(self) -> float:
        """The score: the mean of those."""
        return float(self.per_seed.mean())

    @property
    def interval(self) -> Interval:
        """The score with its interval."""
        return iqm_interval(self.scores, self.trained)

    def entry(self, index: int) -> Interval:
        """The normalised score on one entry of the panel, with an interval by the same rule."""
        return iqm_interval(self.scores[:, index : index + 1], self.trained)

    @cached_property
    def over_chance(self) -> np.ndarray:
        """``(BOOTSTRAPS,)`` scores over resampled evaluation seeds, the same for everybody."""
        weights = resampled(self.scores.shape[2])
        return np.mean([iqm(weights @ scores.T) for scores in self.scores], axis=0)

    @cached_property
    def drawn(self) -> np.ndarray:
        """``(BOOTSTRAPS,)`` scores over what its interval is over: training seeds, or evaluation seeds.

        Fewer than ten training seeds spread too little when they are resampled: their bootstrap is widened
        to the interval of Student's t.
        """
        if not self.seeds:
            return self.over_chance
        key = int.from_bytes(hashlib.sha256(self.slug.encode()).digest()[:8], "big")
        draws = np.random.default_rng(key).integers(0, self.seeds, (BOOTSTRAPS, self.seeds))
        found = self.per_seed[draws].mean(axis=1)
        if self.seeds >= SEEDS_FOR_BOOTSTRAP:
            return found
        wider = student_t(self.seeds) / _NORMAL * np.sqrt(self.seeds / (self.seeds - 1))
        return self.value + wider * (found - self.value)


def standing(result: Result, panel: Panel) -> Standing:
    """The standing of a verified result."""
    (scores,) = score_arrays([line | {"algorithm": ""} for line in result.lines], panel).values()
    return Standing(result.slug, scores, trained=result.lines[0]["training_seed"] is not None)


def lead_shares(entries: Sequence[Standing]) -> np.ndarray:
    """``(n,)``: in which share of the bootstraps each leads; those who lead together share it.

    Entries with few training seeds do not take part: their draws reach so far that any of them, playing at
    random even, would lead in a part.
    """
    part = [entry for entry in entries if not entry.few]
    if not part:
        return np.zeros(len(entries))
    drawn = np.array([entry.drawn for entry in part])
    first = drawn == drawn.max(axis=0)
    shares = iter((first / first.sum(axis=0)).mean(axis=1).tolist())
    return np.array([0.0 if entry.few else next(shares) for entry in entries])


def is_better(one: Standing, other: Standing) -> bool:
    """Whether the one's score is above the other's beyond the chance of 95 % intervals.

    The 95 % interval of the difference, by Welch's t, lies above 0. Its variance is that over training
    seeds of each that has several; where one has not, that of the difference over evaluation seeds, which
    both have played, is added. The spread of the other's few training seeds is left out: it would keep
    anybody from being better than an entry at random. Pairs are not corrected for how many there are.
    """
    difference = one.value - other.value
    if difference <= 0:
        return False
    several = [e for e in (one, other) if e.seeds and not (e is other and e.few)]
    parts = [(e.per_seed.var(ddof=1) / e.seeds, e.seeds - 1) for e in several]
    if len(parts) < 2:
        chance = one.over_chance - other.over_chance
        parts.append((chance.var(ddof=1), one.scores.shape[2] - 1))
    return difference > _welch_half(parts)


def _welch_half(parts: list[tuple[float, int]]) -> float:
    """Half of the 95 % interval of a difference with these variances and degrees of freedom."""
    from scipy.special import stdtrit

    variance = sum(part for part, _ in parts)
    if variance <= 0:
        return 0.0
    freedom = variance**2 / sum(part**2 / count for part, count in parts)
    return float(stdtrit(freedom, 0.975) * np.sqrt(variance))


def rank_ranges(entries: Sequence[Standing]) -> list[tuple[int, int]]:
    """The best and the worst rank of each: 1 + how many are better, n - how many it is better than."""
    better = np.array([[is_better(one, other) for other in entries] for one in entries]).reshape(
        len(entries), len(entries)
    )
    low, high = 1 + better.sum(axis=0), len(entries) - better.sum(axis=1)
    return [(int(a), int(b)) for a, b in zip(low, high, strict=True)]


def improvements(entries: Sequence[Standing]) -> list[list[Interval | None]]:
    """``(n, n)``: how likely a run of the one scores more than one of the other, None of itself."""
    runs = [entry.scores.mean(axis=2) for entry in entries]
    return [
        [probability_of_improvement(one, other) if i != k else None for k, other in enumerate(runs)]
        for i, one in enumerate(runs)
    ]


def profiles(entries: Sequence[Standing]) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds ``(t,)`` over all scores, and ``(n, t)``, the share of runs above each."""
    runs = [entry.scores.mean(axis=2) for entry in entries]
    if not runs:
        return np.zeros(0), np.zeros((0, 0))
    low, high = min(r.min() for r in runs), max(r.max() for r in runs)
    thresholds = np.linspace(np.floor(low / 10) * 10, np.ceil(high / 10) * 10, _THRESHOLDS)
    return thresholds, np.array([performance_profile(r, thresholds) for r in runs])
