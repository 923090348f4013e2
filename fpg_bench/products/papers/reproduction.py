"""The shape of a reproduction: a paper's numbers with their sources, its players, measures and claims."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np

from fpg_bench.common.errors import UserError, shown
from fpg_bench.common.files import read_yaml
from fpg_bench.common.rows import Row
from fpg_bench.common.schema import Items, Strict, parse
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.version import __version__

ENOUGH_ALIKE = 6  # seeds from which on equal values show a sign: 0.025 ** (1 / 6) > 1 / 2
HOLDS, FAILS, OPEN, ONE_SEED, NOT_RUN = "holds", "does not hold", "open", "one seed", "not run"


class Number(Strict):
    """A number or a choice, and where it comes from.

    Attributes:
        name: what it is.
        value: the value, with its unit.
        source: the paper's text, the text as others quote it, a public implementation, or an assumption.
        where: the place, or why it was assumed.
    """

    name: str
    value: str
    source: Literal["paper's text", "paper's text, quoted", "public implementation", "assumption"]
    where: str


class Facts(Strict):
    """Facts of a paper, a YAML file.

    Attributes:
        name: name on the command line.
        title: title of its page.
        citation: authors, title, place.
        about: what is played, a paragraph.
        published_in: where the published values stand.
        published: the paper's values of the first measure, by player and condition.
        numbers: its numbers.
        missing: what could not be had or differs, a sentence each.
    """

    name: str
    title: str
    citation: str
    about: str
    published_in: str
    published: dict[str, dict[str, float | str]]
    numbers: Items[Number]
    missing: Items[str]


def read_facts(name: str) -> Facts:
    """Return the facts in ``<name>.yml``."""
    return parse(Facts, read_yaml(Path(__file__).with_name(f"{name}.yml"), "paper"), f"paper {name}")


@dataclass(frozen=True)
class PaperResults:
    """Finished runs: values by player, condition and measure, each ``(seeds,)`` in the order of seeds.

    Attributes:
        rows: rows of the file by player, condition and seed.
    """

    rows: Mapping[tuple[str, str, int], Row]

    def by_seed(self, player: str, condition: str, measure: str) -> dict[int, float]:
        """Return a measure by seed."""
        return {
            seed: float(row[measure])
            for (who, where, seed), row in sorted(self.rows.items())
            if (who, where) == (player, condition)
        }

    def values(self, player: str, condition: str, measure: str) -> np.ndarray:
        """Return a measure in the order of seeds, ``(seeds,)``."""
        return np.array([*self.by_seed(player, condition, measure).values()])

    def difference(self, measure: str, one: tuple[str, str], other: tuple[str, str]) -> np.ndarray:
        """Return the differences of a measure between two (player, condition) on the seeds of both."""
        first, second = (self.by_seed(*pair, measure) for pair in (one, other))
        return np.array([first[seed] - second[seed] for seed in first if seed in second])


@dataclass(frozen=True)
class PaperClaim:
    """A claim of a paper.

    Attributes:
        statement: what is claimed.
        source: where the paper says so.
        parts: by what each of its parts states, values by seed whose mean is positive if the part holds.
    """

    statement: str
    source: str
    parts: Callable[[PaperResults], Mapping[str, np.ndarray]]


def differences(
    measure: str, pairs: Mapping[str, tuple[tuple[str, str], tuple[str, str]]]
) -> Callable[[PaperResults], Mapping[str, np.ndarray]]:
    """Return the parts of a claim that the first of two (player, condition) has more of a measure."""
    return lambda results: {part: results.difference(measure, *pair) for part, pair in pairs.items()}


@dataclass(frozen=True)
class Paper:
    """A published result, and how it is reproduced.

    Attributes:
        facts: what is known of it.
        players: names of learners and rules.
        conditions: names of conditions.
        measures: what each measure of a row is; the first one is compared with the paper's.
        claims: what is tested.
        play: trains a player under a condition, given the seed and the share of the paper's training, and
            returns its measures.
        curve: measures of learning by the share of the training that is over, for a figure.
    """

    facts: Facts
    players: tuple[str, ...]
    conditions: tuple[str, ...]
    measures: Mapping[str, str]
    claims: tuple[PaperClaim, ...]
    play: Callable[[str, str, int, float], Mapping[str, float]]
    curve: Mapping[float, str] = field(default_factory=dict)


def versions(*libraries: str) -> str:
    """Return the versions of the package and of these libraries."""
    return ", ".join([f"fpg-bench {__version__}", *(f"{name} {version(name)}" for name in libraries)])


def checked_action(action: Any, space: gymnasium.Space[Any]) -> int:
    """Return an action of a game; raises UserError if it is not in the space."""
    if not space.contains(action):
        raise UserError(f"action: expected one of {space}, got {shown(action)}")
    return int(action)


def around(values: np.ndarray, digits: int, factor: float = 1) -> str:
    """Return the mean over seeds and the half width of its 95 % interval (Student's t), as text."""
    mean = f"{factor * values.mean() + 0.0:.{digits}f}"
    return mean if len(values) < 2 else f"{mean} ± {factor * student_half(values):.{digits}f}"


def verdict_of(values: np.ndarray) -> str:
    """Return whether the mean of values by seed is positive, as its 95 % interval says.

    Equal values have an interval without width, but other seeds may differ: by the exact bound of a binomial
    (Clopper and Pearson 1934), six at least show that more than half of all seeds have that sign.
    """
    if len(values) < 2:
        return ONE_SEED if len(values) else NOT_RUN
    if np.ptp(values) == 0 and len(values) < ENOUGH_ALIKE:
        return OPEN
    mean, half = float(values.mean()), student_half(values)
    return HOLDS if mean - half > 0 else FAILS if mean + half < 0 else OPEN


def verdict(claim: PaperClaim, results: PaperResults) -> str:
    """Return the verdict on a claim: it holds if all parts do, and does not if one part does not."""
    verdicts = [verdict_of(values) for values in claim.parts(results).values()]
    return next((word for word in (NOT_RUN, ONE_SEED, FAILS, OPEN) if word in verdicts), HOLDS)
