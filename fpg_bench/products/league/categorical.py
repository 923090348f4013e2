"""Search over numbers on grids by evaluation alone: cross-entropy, then changes of a few numbers at a time.

The cross-entropy method (Rubinstein 1999) draws candidates from a distribution of each number; a local search
then changes one to three numbers at a time, and keeps what is better on seeds on which it was not chosen.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fpg_bench.common.errors import other_content
from fpg_bench.common.schema import NonNegativeInt, Strict
from fpg_bench.evaluation.seeds import TRAINING_STRIDE, training_seed

# The cross-entropy method: generations, candidates and rounds of each, those that are kept, their weight.
CROSS_ENTROPY, CANDIDATES, ROUNDS, ELITE, WEIGHT = 50, 128, 4, 16, 0.3
# Local search: changed candidates, and rounds of each; those that go on to a second test, and its rounds.
MUTANTS, MUTANT_ROUNDS, FINALISTS, FINAL_ROUNDS, MOST_CHANGES = 48, 12, 4, 128, 3
_STRIDE = MUTANT_ROUNDS + FINAL_ROUNDS  # seeds of a generation
_MOST_RIVALS = 8  # that a generation of the cross-entropy method meets

# Options (candidates, numbers), a rival, the first seed and a number of matches -> (candidates, matches)
Play = Callable[[np.ndarray, int, int, int], np.ndarray]


class Generation(Strict):
    """A generation of a search, as a row of its file.

    Attributes:
        generation: its number.
        method: ``cross-entropy`` or ``local search``.
        earned: what the kept candidates earn per step: on average, or against their worst rival.
        kept: the options of each candidate that it keeps: the elite, or the best one.
        known: what candidates last earned of each rival; None of one that was not met yet.
        rounds: number of rounds that it played.
        seconds: CPU seconds.
    """

    generation: NonNegativeInt
    method: Literal["cross-entropy", "local search"]
    earned: float
    kept: list[list[NonNegativeInt]]
    known: list[float | None]
    rounds: int
    seconds: float


@dataclass
class CategoricalSearch:
    """State of a search: a distribution over the options of each number, then the best candidate so far.

    Attributes:
        sizes: ``(n,)``, how many options each number has.
        play: plays candidates against a rival; returns what each earns per step in each match, all candidates
            on the same seeds.
        rivals: number of rivals.
        seed: training seed.
        goal: ``mean`` over the rivals, or ``lowest`` of them.
        generation: number of generations that are finished.
        rounds: number of rounds that they have played.
    """

    sizes: Sequence[int]
    play: Play
    rivals: int = 1
    seed: int = 0
    goal: str = "mean"
    generation: int = 0
    rounds: int = 0
    _best: np.ndarray | None = None
    _shares: np.ndarray = field(init=False)
    _known: list[float | None] = field(init=False)
    _played: int = 0

    def __post_init__(self) -> None:
        self._options = np.array(self.sizes)
        every = np.arange(self._options.max())
        self._shares = np.where(every < self._options[:, None], 1 / self._options[:, None], 0.0)
        self._first_seed = training_seed(self.seed)
        self._known = [None] * self.rivals

    @property
    def best(self) -> np.ndarray:
        """``(n,)``, the best candidate so far: the likeliest one until the local search begins."""
        return self._shares.argmax(axis=1) if self._best is None else self._best

    def run(self) -> Generation:
        """Run the next generation; return its row."""
        began = time.process_time()
        rng = np.random.default_rng([self.seed, self.generation])
        is_local, self._played = self.generation >= CROSS_ENTROPY, 0
        kept, earned = self._improve(rng) if is_local else self._draw(rng)
        row = Generation(
            generation=self.generation,
            method="local search" if is_local else "cross-entropy",
            earned=round(earned, 4),
            kept=kept.tolist(),
            known=self._known,
            rounds=self._played,
            seconds=round(time.process_time() - began, 3),
        )
        self.take(row)
        return row

    def take(self, row: Generation, file: str = "rows") -> None:
        """Take what the next generation keeps; raise UserError for a row of another search, in this file."""
        kept = np.array(row.kept)
        is_known = kept.ndim == 2 and kept.shape[1] == len(self._options) and (kept < self._options).all()
        if not is_known or row.generation != self.generation:
            raise other_content(file, f"generation {row.generation} of another search")
        if self.generation < CROSS_ENTROPY:
            share = (kept[:, :, None] == np.arange(self._shares.shape[1])).mean(axis=0)
            self._shares = (1 - WEIGHT) * self._shares + WEIGHT * share
        else:
            self._best = kept[0]
        self._known, self.rounds = list(row.known), self.rounds + row.rounds
        self.generation += 1

    def _draw(self, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """Draw candidates; return those that earn most, and what they earn."""
        drawn = rng.random((CANDIDATES, len(self._options), 1))
        drawn = (drawn > self._shares.cumsum(axis=1)[:, :-1]).sum(axis=2)
        candidates = np.minimum(drawn, self._options - 1)  # a sum of shares may end just below 1
        if self.goal == "mean":
            met = rng.permutation(self.rivals)[:_MOST_RIVALS]
        else:
            known = [-math.inf if of is None else of for of in self._known]
            met = np.argsort(known, kind="stable")[:_MOST_RIVALS]
        matches = max(1, ROUNDS // len(met))
        earned = self._earned(candidates, met, 0, matches)
        score = self._score(earned)
        elite = np.argsort(-score, kind="stable")[:ELITE]
        for rival, of in zip(met.tolist(), earned[elite].mean(axis=(0, 2)).tolist(), strict=True):
            self._known[rival] = round(of, 4)
        return candidates[elite], float(score[elite].mean())

    def _improve(self, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """Change the best candidate in a few numbers; return the best one after two tests, and what it earns.

        A changed candidate replaces the best one if it earns more by over a standard error, on seeds on which
        it was not chosen.
        """
        best, everybody = self.best, np.arange(self.rivals)
        changed = np.tile(best, (MUTANTS, 1))
        for row in changed:
            at = rng.choice(len(row), min(int(rng.integers(1, MOST_CHANGES + 1)), len(row)), replace=False)
            row[at] = (row[at] + rng.integers(1, np.maximum(self._options[at], 2))) % self._options[at]
        first = self._score(self._earned(changed, everybody, 0, _shared(MUTANT_ROUNDS, self.rivals)))
        finalists = changed[np.argsort(-first, kind="stable")[:FINALISTS]]
        candidates = np.concatenate([best[None], finalists])
        earned = self._earned(candidates, everybody, MUTANT_ROUNDS, _shared(FINAL_ROUNDS, self.rivals))
        k = 1 + int(self._score(earned)[1:].argmax())
        chosen = k if self.gains(earned[k], earned[0]) else 0
        return candidates[chosen][None], float(self._score(earned)[chosen])

    def gains(self, one: np.ndarray, other: np.ndarray) -> bool:
        """Return True if one candidate earns more than another by over a standard error.

        Args:
            one, other: ``(rivals, matches)``, on the same matches.
        """
        apart = one - other
        variances = apart.var(axis=1) / apart.shape[1]
        if self.goal == "mean":
            return bool(apart.mean() > math.sqrt(variances.sum()) / len(variances))
        worst = int(one.mean(axis=1).argmin())
        return bool(one.mean(axis=1).min() - other.mean(axis=1).min() > math.sqrt(variances[worst]))

    def simplify(self) -> np.ndarray:
        """Return the best candidate without the numbers that are worth less than a standard error.

        A number is dropped by giving it its first option; the one that is worth least goes first.
        """
        best, everybody = self.best.copy(), np.arange(self.rivals)
        while len(used := np.flatnonzero(best)):
            simpler = np.tile(best, (len(used), 1))
            simpler[np.arange(len(used)), used] = 0
            candidates = np.concatenate([best[None], simpler])
            earned = self._earned(candidates, everybody, MUTANT_ROUNDS, _shared(FINAL_ROUNDS, self.rivals))
            self.generation, self.rounds = self.generation + 1, self.rounds + len(candidates) * earned[0].size
            k = 1 + int(self._score(earned)[1:].argmax())
            if self.gains(earned[0], earned[k]):
                break
            best = candidates[k]
        return best

    def _earned(self, candidates: np.ndarray, met: np.ndarray, begin: int, matches: int) -> np.ndarray:
        """Return ``(candidates, rivals met, matches)``, what each candidate earns per step."""
        first = self._first_seed + self.generation * _STRIDE % (TRAINING_STRIDE - _STRIDE) + begin
        self._played += len(candidates) * len(met) * matches
        return np.stack([self.play(candidates, int(k), first, matches) for k in met], axis=1)

    def _score(self, earned: np.ndarray) -> np.ndarray:
        """Return ``(candidates,)``, what each earns by the goal."""
        by_rival = earned.mean(axis=2)
        return np.asarray(by_rival.mean(axis=1) if self.goal == "mean" else by_rival.min(axis=1))


def _shared(rounds: int, rivals: int) -> int:
    """Return how many matches each rival has of so many rounds, two at least."""
    return max(2, math.ceil(rounds / rivals))
