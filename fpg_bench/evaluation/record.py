"""Records: results of one training seed of an entry against one rival, as sums that can be pooled."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import ConfigDict, Field, Strict

from fpg_bench.common.checks import check_keys
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.common.schema import Expected, Word, parse
from fpg_bench.game.metrics import CLEAN, GREATEST, measures
from fpg_bench.game.state import TALLY

if TYPE_CHECKING:
    from fpg_bench.game.batch import GameBatch

TALLIES = tuple(TALLY.names or ())
HOP_BITS = "hop_bits"  # beside a tally: the entropy of a hop's destination, times the number of hops
# Every record has the first sums, and the hash of its rounds covers them; older records lack later ones.
HASHED_TALLIES = TALLIES[: TALLIES.index("opponent_return") + 1]
LATER_TALLIES = (*TALLIES[len(HASHED_TALLIES) :], CLEAN, HOP_BITS)
_NAMES = (*HASHED_TALLIES, *LATER_TALLIES)
_FALLBACK = "fallback"
_BOUND = 10**15  # larger than any real sum
_MOST_STATUSES = 100


# Types of what a record holds, which may come from anybody; lists stop at their first bad number.
Number = Annotated[float, Strict(), Field(gt=-_BOUND, lt=_BOUND)]
Count = Annotated[int, Strict(), Field(ge=0, lt=_BOUND), Expected("a whole number, 0 or more")]
Numbers = Annotated[tuple[Number, ...], Field(min_length=1, fail_fast=True)]
Counts = Annotated[tuple[Count, ...], Field(min_length=1, fail_fast=True)]
_CONFIG = ConfigDict(extra="forbid", allow_inf_nan=False)
MatchupKey = tuple[str, str, int | None, str, str]


@dataclass(frozen=True)
class Plans:
    """Statistics of the paths that a planner's opponent flew.

    Attributes:
        statuses: number of plans by status.
        tokens: total over all plans; None without a language model.
        seconds: total over all plans, on the machine that played; 0 if they don't count.
        useless: number of valid but useless plans by sign; None if it was not checked.
    """

    __pydantic_config__ = _CONFIG

    statuses: dict[Word, Count]
    tokens: Count | None
    seconds: Number = 0.0
    useless: dict[Word, Count] | None = None

    @property
    def valid(self) -> float | None:
        """Share of plans that are a language model's own, no fallback; None without a model."""
        count = sum(self.statuses.values())
        fallbacks = sum(n for status, n in self.statuses.items() if status.startswith(_FALLBACK))
        return None if not count or (self.tokens is None and not fallbacks) else 1 - fallbacks / count

    @property
    def valid_but_useless(self) -> float | None:
        """Share of plans that were valid and of no use; None if it was not checked."""
        return None if self.useless is None else sum(self.useless.values()) / sum(self.statuses.values())


@dataclass(frozen=True)
class Record:
    """Results of one training seed of an entry against one rival.

    Attributes:
        suite, suite_hash: the suite's name, and the first 16 digits of its hash.
        entry: the entry's name.
        training_seed: None for a script or a planner.
        fingerprint: the first 16 digits of the hash that tells players of one name apart.
        rival: the rival's name.
        returns: of each round, in the order of seed and round.
        tally: sums of ``state.TALLY`` over all rounds; the longest outage is the greatest. In the model
            ``link`` also ``clean_mbit_s``, and ``hop_bits``, the number of hops times the entropy of a hop's
            destination given the point it leaves. Those that were added later are not in every record.
        ally_points, jam_points: steps per frequency point of both sides' centres.
        lost: number of rounds lost by an answer that is not a valid action.
        rounds_sha256: of the tallies of all rounds, as far as every record has them.
        plans: statistics of planned paths; None if the entry plans none.
    """

    __pydantic_config__ = _CONFIG

    suite: Word
    suite_hash: Word
    entry: Word
    training_seed: Count | None
    fingerprint: Word
    rival: Word
    returns: Numbers
    tally: dict[str, Number]
    ally_points: Counts
    jam_points: Counts
    lost: Count
    rounds_sha256: Word
    plans: Plans | None = None

    @property
    def key(self) -> MatchupKey:
        """Key that tells it from the records of other matchups."""
        return self.suite_hash, self.entry, self.training_seed, self.fingerprint, self.rival

    def row(self) -> Row:
        """Return the record as a row of JSON; the tuples of its rounds' numbers are shared, not copied."""
        row: Row = {spec.name: getattr(self, spec.name) for spec in dataclasses.fields(self)}
        row["tally"] = dict(self.tally)
        if self.plans is None:
            del row["plans"]
            return row
        row["plans"] = dataclasses.asdict(self.plans)
        if self.plans.useless is None:
            del row["plans"]["useless"]
        return row

    @classmethod
    def read(cls, row: Row, where: str) -> Record:
        """Return the record of an untrusted row; see :func:`read_record`."""
        return read_record(row, where)


@dataclass(frozen=True)
class Pooled:
    """Sums of several records.

    Attributes:
        tally: sums by name, of those that all records have; the longest outage is the greatest.
        histogram: ``(2, points)``, the ally's and the jammer's steps per frequency point.
        rounds: number of rounds.
        lost: number of lost rounds.
        plans: of planners; None for others.
    """

    tally: dict[str, float]
    histogram: np.ndarray
    rounds: int
    lost: int
    plans: Plans | None

    @property
    def measures(self) -> dict[str, float | None]:
        """:func:`fpg_bench.game.metrics.measures`, with both sides' returns as means per round.

        ``hop_entropy_bits`` is a mean over hops of the entropy in the records that they were counted in.
        """
        returns = {name: self.tally[name] / self.rounds for name in ("ally_return", "opponent_return")}
        is_known = HOP_BITS in self.tally and self.tally["hops"]
        entropy = self.tally[HOP_BITS] / self.tally["hops"] if is_known else None
        return measures(self.tally, self.histogram) | returns | {"hop_entropy_bits": entropy}


def pool(records: Sequence[Record]) -> Pooled:
    """Pool one or more records: add their sums, and take the maximum of the longest outage."""
    ordered = sorted(records, key=lambda record: (record.suite, record.rival, str(record.training_seed)))
    names = [name for name in _NAMES if all(name in record.tally for record in ordered)]
    tallies = {name: [record.tally[name] for record in ordered] for name in names}
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
    statuses = sum((Counter(each.statuses) for each in plans), Counter[str]())
    tokens = [each.tokens for each in plans if each.tokens is not None]
    seconds = sum(each.seconds for each in plans)
    signs = [Counter(each.useless) for each in plans if each.useless is not None]
    useless = dict(sorted(sum(signs, Counter[str]()).items())) if signs else None
    return Plans(dict(sorted(statuses.items())), sum(tokens) if tokens else None, seconds, useless)


_KEYS = [spec.name for spec in dataclasses.fields(Record)]


def read_record(row: Row, where: str) -> Record:
    """Validate a row from anywhere as a record.

    Raises:
        UserError: a key missing or unknown, or a value that no record has; ``where`` begins the message.
    """
    check_keys(row, _KEYS, where, needed=[key for key in _KEYS if key != "plans"])
    tally, plans = row["tally"], row.get("plans")
    check_keys(tally, _NAMES, f"{where}: tally", needed=HASHED_TALLIES)
    held = plans.values() if isinstance(plans, dict) else ()
    if any(isinstance(value, dict) and len(value) > _MOST_STATUSES for value in held):
        raise UserError(f"{where}: plans: more than {_MOST_STATUSES} statuses")
    record = parse(Record, row, where)
    if record.lost > len(record.returns):
        raise UserError(f"{where}: lost: expected at most {len(record.returns)} rounds, got {record.lost}")
    if len(record.ally_points) != len(record.jam_points):
        raise UserError(f"{where}: ally_points and jam_points: expected lists of one length")
    if record.tally["steps"] <= 0:
        raise UserError(f"{where}: tally: steps: expected a number above 0, got {record.tally['steps']:g}")
    return record


def read_records(rows: Iterable[Row], where: str) -> list[Record]:
    """Validate rows as records, each matchup there once.

    Raises:
        UserError: as :func:`read_record`, with the number of the row; or two records of one matchup.
    """
    records = [read_record(row, f"{where}: record {number}") for number, row in enumerate(rows, 1)]
    known: dict[MatchupKey, int] = {}
    for number, record in enumerate(records, 1):
        if (first := known.setdefault(record.key, number)) != number:
            raise UserError(
                f"{where}: record {number} is of the same matchup as record {first}; remove one of them"
            )
    return records


class HopCounts:
    """Counts of the ally's hops from point to point in a batch of games; a round's first step is left out.

    Args:
        batch: the games.
    """

    def __init__(self, batch: GameBatch) -> None:
        self._games = batch.games
        points = batch.scenario.frequency_points
        self.counts = np.zeros((points, points), np.int64)
        self._before = np.zeros(batch.count, np.int64)

    def count(self) -> None:
        """Add the hops of the step just played."""
        point = self._games["point"].copy()
        hopped = self._games["hopped"] & (self._games["step"] > 1)
        np.add.at(self.counts, (self._before[hopped], point[hopped]), 1)
        self._before = point


def conditional_entropy(counts: np.ndarray) -> float:
    """Return the entropy of a destination given its origin, in bits; 0 without any count.

    >>> conditional_entropy(np.array([[0, 4, 4], [8, 0, 0], [0, 0, 0]]))
    0.5

    Args:
        counts: ``(origins, destinations)``.
    """
    total = counts.sum()
    if not total:
        return 0.0
    of_origin = np.broadcast_to(counts.sum(axis=1, keepdims=True), counts.shape)
    there = counts > 0
    return float((counts[there] * np.log2(of_origin[there] / counts[there])).sum() / total)
