"""Lines: what one training seed of an entry came to against one rival, as sums that can be pooled."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.game.measures import GREATEST, measures
from fpg_bench.game.state import TALLY

TALLIES = tuple(TALLY.names or ())
_ENDLESS = 1e15  # no sum comes near it, and no number that is not finite lies below
_FALLBACK = "fallback"
_LONGEST = 200  # characters of a name


@dataclass(frozen=True)
class Plans:
    """How the paths came about that a planner's opponent flew.

    Attributes:
        statuses: how many plans had which.
        tokens: of all plans together; None where no language model is asked.
        seconds: of all plans together, on the machine that played; 0 where they don't count.
        useless: how many valid ones show which sign of being of no use; None where nobody has looked.
    """

    statuses: dict[str, int]
    tokens: int | None
    seconds: float = 0.0
    useless: dict[str, int] | None = None

    @property
    def valid(self) -> float | None:
        """The share of plans that were a language model's own and no fallback; None where none is asked."""
        count = sum(self.statuses.values())
        fallen = sum(n for status, n in self.statuses.items() if status.startswith(_FALLBACK))
        return None if not count or (self.tokens is None and not fallen) else 1 - fallen / count

    @property
    def valid_but_useless(self) -> float | None:
        """The share of plans that were valid and of no use; None where nobody has looked."""
        return None if self.useless is None else sum(self.useless.values()) / sum(self.statuses.values())


@dataclass(frozen=True)
class Record:
    """One training seed of an entry against one rival.

    Attributes:
        suite, field_hash: the suite's name, and the first 16 digits of its hash.
        entry: the entry's name.
        training_seed: None for a script or a planner.
        fingerprint: the first 16 digits of what tells two players of one name apart.
        rival: the rival's name.
        returns: of each round, in the order of seed and round.
        tally: the sums of ``state.TALLY`` over all rounds; the longest outage is the greatest.
        ally_points, jam_points: steps per frequency point of both sides' centres.
        lost: rounds lost by an answer that is no action.
        rounds_sha256: of the tallies of all rounds.
        plans: how planned paths came about; None where the entry plans none.
    """

    suite: str
    suite_hash: str
    entry: str
    training_seed: int | None
    fingerprint: str
    rival: str
    returns: tuple[float, ...]
    tally: dict[str, float]
    ally_points: tuple[int, ...]
    jam_points: tuple[int, ...]
    lost: int
    rounds_sha256: str
    plans: Plans | None = None

    def row(self) -> Row:
        """The line as a row of JSON; the numbers of its rounds, which are most of it, are not copied."""
        row: Row = {spec.name: getattr(self, spec.name) for spec in dataclasses.fields(self)}
        row["tally"] = dict(self.tally)
        if self.plans is None:
            del row["plans"]
            return row
        row["plans"] = dataclasses.asdict(self.plans)
        if self.plans.useless is None:
            del row["plans"]["useless"]
        return row

    def same_as(self, other: Record) -> bool:
        """Whether two lines say the same, the seconds that planning took aside."""
        return _timeless(self) == _timeless(other)


@dataclass(frozen=True)
class Pooled:
    """The sums of several lines.

    Attributes:
        tally: sums by the names of ``state.TALLY``; the longest outage is the greatest.
        histogram: ``(2, points)``, the ally's and the jammer's steps per frequency point.
        rounds: how many rounds they are of.
        lost: how many of those were lost.
        plans: of planners; None of others.
    """

    tally: dict[str, float]
    histogram: np.ndarray
    rounds: int
    lost: int
    plans: Plans | None

    @property
    def measures(self) -> dict[str, float | None]:
        """:func:`fpg_bench.game.measures.measures`, with both sides' returns as means a round."""
        found = measures(self.tally, self.histogram)
        return found | {name: self.tally[name] / self.rounds for name in ("ally_return", "opponent_return")}


def pool(records: Sequence[Record]) -> Pooled:
    """Add up lines, at least one: sums of sums, and the greatest of the greatest."""
    ordered = sorted(records, key=lambda record: (record.suite, record.rival, str(record.training_seed)))
    tallies = {name: [record.tally[name] for record in ordered] for name in TALLIES}
    tally = {name: max(values) if name == GREATEST else sum(values) for name, values in tallies.items()}
    histogram = np.sum([[record.ally_points, record.jam_points] for record in ordered], axis=0)
    return Pooled(
        tally,
        histogram,
        rounds=sum(len(record.returns) for record in ordered),
        lost=sum(record.lost for record in ordered),
        plans=_pooled_plans([record.plans for record in ordered if record.plans is not None]),
    )


def _pooled_plans(plans: Sequence[Plans]) -> Plans | None:
    if not plans:
        return None
    statuses = sum((Counter(of.statuses) for of in plans), Counter[str]())
    tokens = [of.tokens for of in plans if of.tokens is not None]
    seconds = sum(of.seconds for of in plans)
    signs = [Counter(of.useless) for of in plans if of.useless is not None]
    useless = dict(sorted(sum(signs, Counter[str]()).items())) if signs else None
    return Plans(dict(sorted(statuses.items())), sum(tokens) if tokens else None, seconds, useless)


def read_record(row: Row, where: str) -> Record:
    """The line of a row, from anywhere; every value is looked at.

    Raises:
        UserError: a key missing or unknown, or a value that no line has; ``where`` begins the message.
    """
    known = {spec.name for spec in dataclasses.fields(Record)}
    if row.keys() not in (known, known - {"plans"}) or not all(check(row) for check in _CHECKS):
        raise UserError(f"{where} is no line of a rival")
    plans = None
    if row.get("plans") is not None:
        plans = _read_plans(row["plans"], where)
    lists = {key: tuple(row[key]) for key in ("returns", "ally_points", "jam_points")}
    return Record(**(row | lists | {"plans": plans}))


def _read_plans(row: Any, where: str) -> Plans:
    known = {"statuses", "tokens", "seconds"}
    sound = isinstance(row, dict) and row.keys() in (known, known | {"useless"})
    if not sound or not all(_are_counts(row[key]) for key in row if key in ("statuses", "useless")):
        raise UserError(f"{where} does not tell of its plans what it should")
    if not _are_numbers([row["seconds"]]):
        raise UserError(f"{where} does not tell of its plans what it should")
    if row["tokens"] is not None and not _is_count(row["tokens"]):
        raise UserError(f"{where}: tokens: expected a whole number, got {row['tokens']!r:.40}")
    return Plans(**row)


def _is_count(value: Any) -> bool:
    return _are_numbers([value], {int}) and value >= 0


def _are_counts(value: Any) -> bool:
    return isinstance(value, dict) and all(_is_word(s) and _is_count(n) for s, n in value.items())


def _is_word(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST and value.isprintable()


def _are_numbers(values: Any, kinds: Set[type] = frozenset({int, float})) -> bool:
    """Whether there are some and all are of these kinds; without a loop, as a board has millions of them."""
    if not isinstance(values, list | tuple) or not values or not set(map(type, values)) <= kinds:
        return False
    return all(map(_ENDLESS.__gt__, map(abs, values)))


def _are_all_counts(values: Any) -> bool:
    return _are_numbers(values, {int}) and min(values) >= 0


_WORDS = ("suite", "suite_hash", "entry", "fingerprint", "rival", "rounds_sha256")
_CHECKS = (
    lambda row: all(_is_word(row[key]) for key in _WORDS),
    lambda row: row["training_seed"] is None or _is_count(row["training_seed"]),
    lambda row: _are_numbers(row["returns"]) and _is_count(row["lost"]),
    lambda row: row["lost"] <= len(row["returns"]),
    lambda row: all(_are_all_counts(row[key]) for key in ("ally_points", "jam_points")),
    lambda row: len(row["ally_points"]) == len(row["jam_points"]),
    lambda row: isinstance(row["tally"], dict) and tuple(row["tally"]) == TALLIES,
    lambda row: _are_numbers(list(row["tally"].values())) and row["tally"]["steps"] > 0,
)


def read_records(rows: Iterable[Row], where: str) -> list[Record]:
    """The lines of all rows, each there once.

    Raises:
        UserError: as :func:`read_line`, with the number of the row; or two lines are of the same meeting.
    """
    records = [read_record(row, f"{where}: line {number}") for number, row in enumerate(rows, 1)]
    known: dict[tuple[Any, ...], int] = {}
    for number, record in enumerate(records, 1):
        matchup = record.suite_hash, record.entry, record.training_seed, record.fingerprint, record.rival
        if (first := known.setdefault(matchup, number)) != number:
            raise UserError(f"{where}: line {number} tells again of what line {first} does; take one away")
    return records


def _timeless(record: Record) -> Record:
    plans = record.plans
    return dataclasses.replace(record, plans=plans and dataclasses.replace(plans, seconds=0.0))
