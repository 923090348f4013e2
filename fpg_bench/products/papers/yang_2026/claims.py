"""The paper's claims and the paired tests that decide whether they hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from fpg_bench.evaluation.statistics import student_half
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.products.papers.yang_2026.conditions import (
    BASE,
    FIXED_PATHS,
    NO_KNOWLEDGE,
    NO_PLANNER,
    swapped,
)
from fpg_bench.products.papers.yang_2026.facts import FACTS
from fpg_bench.products.papers.yang_2026.runs import STAGES, Runs

MOST_PAIRS = 16  # 2^16 patterns of signs


@dataclass(frozen=True)
class PairedTest:
    """Result of a paired test.

    Attributes:
        mean: mean difference.
        low, high: 95 % interval of the mean (Student's t).
        effect: mean in standard deviations of the differences (Cohen's d_z); None if they do not vary.
        p: two-sided p value of the exact sign-flip permutation test of the mean.
        pairs: number of pairs.
    """

    mean: float
    low: float
    high: float
    effect: float | None
    p: float
    pairs: int


def paired_test(differences: np.ndarray) -> PairedTest:
    """Test whether the mean of paired differences ``(pairs,)`` is zero.

    Raises:
        ValueError: fewer than two pairs, or more than can be enumerated.
    """
    count = len(differences)
    if not 2 <= count <= MOST_PAIRS:
        raise ValueError(f"expected 2 to {MOST_PAIRS} pairs, got {count}")
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    half = student_half(differences)
    effect = mean / spread if spread > 0 else None
    return PairedTest(mean, mean - half, mean + half, effect, sign_flip_p(differences), count)


def sign_flip_p(differences: np.ndarray) -> float:
    """Return the two-sided p value of the sign-flip permutation test.

    It is the share of sign patterns whose mean is at least as far from zero. With n pairs it is at least
    2 / 2^n: 0.0625 with five, 0.002 with ten.
    """
    signs = np.array(list(product((1.0, -1.0), repeat=len(differences))))
    means = np.abs(signs @ differences)
    observed = abs(float(differences.sum()))
    return float((means >= observed - 1e-9 * max(observed, 1e-300)).mean())


def holm(ps: Sequence[float]) -> list[float]:
    """Return p values corrected for multiple tests by Holm's step-down method."""
    order = np.argsort(ps, kind="stable")
    corrected, greatest = [0.0] * len(ps), 0.0
    for rank, index in enumerate(order.tolist()):
        greatest = max(greatest, min(1.0, (len(ps) - rank) * ps[index]))
        corrected[index] = greatest
    return corrected


LEVEL = 0.05
HOLDS, REVERSED, OPEN = "holds", "the opposite", "not shown"
NOT_RUN = "not run"
CLAIMS = FACTS.claims

# Pairs of jamming types: alone, the first one earns more than the second.
STRONGER = (
    *((kind, "tone") for kind in JAMMING_TYPES[1:]),
    *(("broadband", kind) for kind in ("narrowband", "comb")),
)


@dataclass(frozen=True)
class Comparison:
    """One test of a claim.

    Attributes:
        claim: key of :data:`CLAIMS`.
        statement: quantity claimed to be positive.
        test: test in rounds without noise after training; for D2, over training.
        with_noise: the same test late in training, with exploration noise; None for changes over training.
        p: p value of ``test``, corrected for all tests of the claim (Holm).
    """

    claim: str
    statement: str
    test: PairedTest
    with_noise: PairedTest | None
    p: float

    @property
    def verdict(self) -> str:
        """Verdict on the statement by itself: :data:`HOLDS`, :data:`REVERSED` or :data:`OPEN`."""
        if self.p >= LEVEL:
            return OPEN
        return HOLDS if self.test.mean > 0 else REVERSED

    @property
    def holds_uncorrected(self) -> bool:
        """True if it holds as a part of its claim, which holds if all parts do (intersection-union)."""
        return self.test.p < LEVEL and self.test.mean > 0


def compare(results: Runs) -> list[Comparison]:
    """Return all tests whose conditions have at least two seeds."""
    differences = [each for each in _differences(results) if len(each.finals) > 1]
    comparisons = []
    for claim in CLAIMS:
        family = [each for each in differences if each.claim == claim]
        tests = [paired_test(each.finals) for each in family]
        for each, test, p in zip(family, tests, holm([test.p for test in tests]), strict=True):
            with_noise = None if each.with_noise is None else paired_test(each.with_noise)
            comparisons.append(Comparison(claim, each.statement, test, with_noise, p))
    return comparisons


def verdict(comparisons: list[Comparison]) -> str:
    """Return the verdict on a claim: it holds if all its tests do, without correction.

    A correction is not needed since all of them have to hold (intersection-union test, Berger 1982).
    """
    verdicts = [each.verdict for each in comparisons]
    if not verdicts:
        return NOT_RUN
    if all(each.holds_uncorrected for each in comparisons):
        return HOLDS
    held = f"{verdicts.count(HOLDS)} of {len(verdicts)} parts hold"
    if REVERSED in verdicts:
        return f"does not hold ({held}, of {verdicts.count(REVERSED)} the opposite)"
    return f"not shown ({held})"


class _Differences(NamedTuple):
    """Differences by seed, ``(seeds,)``; see :class:`Comparison`."""

    claim: str
    statement: str
    finals: np.ndarray
    with_noise: np.ndarray | None


def _differences(results: Runs) -> Iterator[_Differences]:
    ally, opponent = "ally_reward", "opponent_reward"
    for path in FIXED_PATHS:
        statement = f"opponent's reward: planned - {path}"
        yield _between(results, "D1", statement, (BASE, opponent), (path, opponent))
    for path in FIXED_PATHS:
        statement = f"opponent's reward: planned - {path}, of the same pair"
        seeds = results.seeds(BASE, swapped(BASE, path))
        planned, fixed = (results.final(name, opponent, seeds) for name in (BASE, swapped(BASE, path)))
        yield _Differences("D1 frozen", statement, planned - fixed, None)
    yield from _over_training(results)
    for kind in JAMMING_TYPES:
        statement = f"{kind} alone: ally's - opponent's reward"
        yield _between(results, "D3", statement, (kind, ally), (kind, opponent))
    for strong, weak in STRONGER:
        statement = f"opponent's reward: {strong} - {weak}"
        yield _between(results, "D3", statement, (strong, opponent), (weak, opponent))
    statement = "opponent's reward: planned - learned path"
    yield _between(results, "D4", statement, (BASE, opponent), (NO_PLANNER, opponent))
    statement = "ally's reward: with - without knowledge base"
    yield _between(results, "D4", statement, (BASE, ally), (NO_KNOWLEDGE, ally))


def _between(
    results: Runs, claim: str, statement: str, one: tuple[str, str], other: tuple[str, str]
) -> _Differences:
    """Subtract the column of one condition from that of another; both are (condition, column)."""
    seeds = results.seeds(one[0], other[0])
    finals, levels = (read(*one, seeds) - read(*other, seeds) for read in (results.final, results.level))
    return _Differences(claim, statement, finals, levels)


def _over_training(results: Runs) -> Iterator[_Differences]:
    """Compare the early and late stages of Fig. 4: overlap should fall, and jamming success rise."""
    seeds = results.seeds(BASE)
    early, late = (
        [results.mean(BASE, name, STAGES[stage], seeds) for name in ("overlap_ratio", "jamming_success_rate")]
        for stage in ("early", "late")
    )
    yield _Differences("D2", "overlap ratio: early - late", early[0] - late[0], None)
    yield _Differences("D2", "jamming success rate: late - early", late[1] - early[1], None)
    spectra = [results.overlap(BASE, stage, seeds) for stage in ("early", "late")]
    yield _Differences("D2", "spectrum overlap: early - late", spectra[0] - spectra[1], None)
