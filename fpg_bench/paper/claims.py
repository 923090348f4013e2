"""The paper's claims as paired tests: what it states, what is compared, and whether that holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from fpg_bench.evaluation.statistics import student_half
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.paper.conditions import BASE, FIXED_PATHS, NO_KNOWLEDGE, NO_PLANNER, swapped
from fpg_bench.paper.runs import STAGES, Results

MOST_PAIRS = 16  # 2^16 patterns of signs


@dataclass(frozen=True)
class Paired:
    """What pairs of runs say of a difference.

    Attributes:
        mean: of the differences.
        low, high: its 95 % interval (Student's t).
        effect: the mean in standard deviations of the differences (Cohen's d_z); None where they do not vary.
        p: two-sided, of the exact sign-flip permutation test of the mean.
        pairs: how many.
    """

    mean: float
    low: float
    high: float
    effect: float | None
    p: float
    pairs: int


def paired(differences: np.ndarray) -> Paired:
    """Test whether differences ``(pairs,)`` of runs of the same seeds lie around zero.

    Raises:
        ValueError: fewer than two pairs, or more than can be enumerated.
    """
    count = len(differences)
    if not 2 <= count <= MOST_PAIRS:
        raise ValueError(f"expected 2 to {MOST_PAIRS} pairs, got {count}")
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    half = student_half(differences)
    effect = mean / spread if spread > 0 else None
    return Paired(mean, mean - half, mean + half, effect, sign_flip_p(differences), count)


def sign_flip_p(differences: np.ndarray) -> float:
    """The two-sided p of the permutation test: how many patterns of signs give a mean as far from zero.

    With n pairs it is at least 2 / 2^n: 0.0625 with five, 0.002 with ten.
    """
    signs = np.array(list(product((1.0, -1.0), repeat=len(differences))))
    means = np.abs(signs @ differences)
    observed = abs(float(differences.sum()))
    return float((means >= observed - 1e-9 * max(observed, 1e-300)).mean())


def holm(ps: Sequence[float]) -> list[float]:
    """Holm's step-down correction: p values that may be compared with 0.05 each, all tests together."""
    order = np.argsort(ps, kind="stable")
    found, greatest = [0.0] * len(ps), 0.0
    for rank, index in enumerate(order.tolist()):
        greatest = max(greatest, min(1.0, (len(ps) - rank) * ps[index]))
        found[index] = greatest
    return found


LEVEL = 0.05
HOLDS, REVERSED, OPEN = "holds", "the opposite", "not shown"
NOT_RUN = "not run"
CLAIMS = {
    "D1": "Planned paths serve the opponent better than fixed ones (Fig. 3)",
    "D1 frozen": "They do so with the same trained pair, where nothing but the path is exchanged",
    "D2": "Overlap falls over training while jamming success rises (Fig. 4 and 5)",
    "D3": "Each jamming type alone leaves the opponent below the ally; single tone is weakest, broadband "
    "strongest (Fig. 6)",
    "D4": "Without the planner the opponent is worse, without the knowledge base the ally (Fig. 7)",
}

# Which jamming type earns more alone than which other one.
STRONGER = (
    *((kind, "tone") for kind in JAMMING_TYPES[1:]),
    *(("broadband", kind) for kind in ("narrowband", "comb")),
)
# Parts of claims that can hold by themselves.
ASPECTS = {
    "D1": CLAIMS["D1"],
    "D2": CLAIMS["D2"],
    "D3 level": "Each jamming type alone leaves the opponent below the ally",
    "D3 order": "Single tone is weakest, broadband strongest",
    "D4 planner": "Without the planner, where it learns to fly, the opponent is worse",
    "D4 knowledge": "Without the knowledge base the ally is worse",
}


@dataclass(frozen=True)
class Comparison:
    """One test behind a claim.

    Attributes:
        claim: of :data:`CLAIMS`.
        statement: what is claimed to be positive.
        found: what the pairs say, in rounds without noise after training; of D2, over training.
        check: the same differences late in training, with its noise; None where there are none.
        p: corrected for all tests of the claim (Holm).
    """

    claim: str
    statement: str
    found: Paired
    check: Paired | None
    p: float

    @property
    def verdict(self) -> str:
        """Whether the statement holds by itself, its opposite does, or neither is shown."""
        if self.p >= LEVEL:
            return OPEN
        return HOLDS if self.found.mean > 0 else REVERSED

    @property
    def holds_uncorrected(self) -> bool:
        """Whether it counts as a part of its claim, which needs all of them (intersection-union)."""
        return self.found.p < LEVEL and self.found.mean > 0


def aspect_of(comparison: Comparison) -> str:
    """Which of :data:`ASPECTS` a test is a part of; ``D1 frozen`` is one more."""
    claim, said = comparison.claim, comparison.statement
    if claim == "D3":
        return "D3 level" if "alone" in said else "D3 order"
    if claim == "D4":
        return "D4 planner" if "learned path" in said else "D4 knowledge"
    return claim


def compare(results: Results) -> list[Comparison]:
    """All tests whose runs are there, with at least two seeds."""
    pairs = [pair for pair in _differences(results) if len(pair[2]) > 1]
    found = [paired(differences) for _, _, differences, _ in pairs]
    comparisons = []
    for claim in CLAIMS:
        family = [(pair, each) for pair, each in zip(pairs, found, strict=True) if pair[0] == claim]
        corrected = holm([each.p for _, each in family])
        comparisons += [
            Comparison(claim, statement, each, None if check is None else paired(check), p)
            for ((_, statement, _, check), each), p in zip(family, corrected, strict=True)
        ]
    return comparisons


def verdict(comparisons: list[Comparison]) -> str:
    """What the tests behind one claim come to: it holds where all of them do, none of them corrected.

    All have to hold, so none can hold by chance alone, and a correction would guard twice (Berger 1982).
    """
    found = [each.verdict for each in comparisons]
    if not found:
        return NOT_RUN
    if all(each.holds_uncorrected for each in comparisons):
        return HOLDS
    held = f"{found.count(HOLDS)} of {len(found)} parts hold"
    if REVERSED in found:
        return f"does not hold ({held}, of {found.count(REVERSED)} the opposite)"
    return f"not shown ({held})"


_Difference = tuple[str, str, np.ndarray, np.ndarray | None]


def _differences(results: Results) -> Iterator[_Difference]:
    """The claim, what is claimed to be positive, the differences by seed, and the same with noise."""
    reward = "opponent_reward"
    for path in FIXED_PATHS:
        statement = f"opponent's reward: planned - {path}"
        yield _between(results, "D1", statement, (BASE, reward), (path, reward))
    for path in FIXED_PATHS:
        seeds = results.seeds(BASE, swapped(BASE, path))
        both = [results.final(name, reward, seeds) for name in (BASE, swapped(BASE, path))]
        yield "D1 frozen", f"opponent's reward: planned - {path}, of the same pair", both[0] - both[1], None
    yield from _over_time(results)
    for kind in JAMMING_TYPES:
        statement = f"{kind} alone: ally's - opponent's reward"
        yield _between(results, "D3", statement, (kind, "ally_reward"), (kind, reward))
    for more, less in STRONGER:
        yield _between(results, "D3", f"opponent's reward: {more} - {less}", (more, reward), (less, reward))
    statement = "opponent's reward: planned - learned path"
    yield _between(results, "D4", statement, (BASE, reward), (NO_PLANNER, reward))
    statement = "ally's reward: with - without knowledge base"
    yield _between(results, "D4", statement, (BASE, "ally_reward"), (NO_KNOWLEDGE, "ally_reward"))


def _between(
    results: Results, claim: str, statement: str, one: tuple[str, str], other: tuple[str, str]
) -> _Difference:
    """A condition's column less another's."""
    seeds = results.seeds(one[0], other[0])
    finals, levels = (read(*one, seeds) - read(*other, seeds) for read in (results.final, results.level))
    return claim, statement, finals, levels


def _over_time(results: Results) -> Iterator[_Difference]:
    """Late minus early, in the windows of Fig. 4; the claim is that overlap falls and success rises."""
    seeds = results.seeds(BASE)
    for name, said, sign in (
        ("overlap_ratio", "overlap ratio: early - late", -1),
        ("jamming_success_rate", "jamming success rate: late - early", 1),
    ):
        early, late = (results.mean(BASE, name, STAGES[stage], seeds) for stage in ("early", "late"))
        yield "D2", said, sign * (late - early), None
    early, late = (results.overlap(BASE, stage, seeds) for stage in ("early", "late"))
    yield "D2", "spectrum overlap: early - late", early - late, None
