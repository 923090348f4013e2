"""Stores of pairings: who met whom, each pairing once, in an append-only file or in memory.

A store reads its own file and no other, so all its rows have one origin and one trust: what the board
verifies is never taken from the zoo. Rows of suites are records; cross-play, responses and teams have kinds
of their own.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile, sealed, unsealed
from fpg_bench.common.schema import Strict, parse
from fpg_bench.evaluation.entry import EvaluatedPlayer, check_distinct
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import MatchupKey, Record, read_records
from fpg_bench.evaluation.suite import Rival, Suite

RECORDS = "records.jsonl"
# Called with the rounds of each match of this pairing that were played; and those of all, and of how many.
Progress = Callable[[EvaluatedPlayer, Rival, int, int, int], None]


class Encounter(Protocol):
    """Players who meet."""

    @property
    def key(self) -> Hashable:
        """Key of its result."""

    @property
    def name(self) -> str:
        """Name in messages."""


class EncounterResult(Protocol):
    """Result of an encounter."""

    @property
    def key(self) -> Hashable:
        """Key of the encounter."""

    def row(self) -> Row:
        """Return the result as a row of JSON."""

    @classmethod
    def read(cls, row: Row, where: str) -> Self:
        """Return the result of an untrusted row; raises UserError, which begins with ``where``."""


class StrictResult(Strict):
    """Base class of models of results, whose rows have a hash each."""

    def row(self) -> Row:
        """Return the result as a row of JSON, with its hash."""
        return sealed(self.model_dump(mode="json"))

    @classmethod
    def read(cls, row: Row, where: str) -> Self:
        """Return the result of an untrusted row, which must fit its hash."""
        return parse(cls, unsealed(row, where), where)


M = TypeVar("M", bound=Encounter)
R = TypeVar("R", bound=EncounterResult)


class Pairing(NamedTuple):
    """A player and the rival that it meets; the suite has the matches' number and seeds."""

    entry: EvaluatedPlayer
    suite: Suite
    rival: Rival

    @property
    def key(self) -> MatchupKey:
        """Key of its record."""
        entry, rival = self.entry, self.rival
        return (self.suite.hash[:16], entry.name, entry.training_seed, entry.fingerprint[:16], rival.name)

    @property
    def name(self) -> str:
        """Name in messages."""
        seed = "" if self.entry.training_seed is None else f"/seed_{self.entry.training_seed}"
        return f"{self.entry.name}{seed} - {self.rival.name}"


def pairings(entries: Iterable[EvaluatedPlayer], suite: Suite) -> list[Pairing]:
    """Return the pairings of entries with all rivals of a suite, entry by entry."""
    return [Pairing(entry, suite, rival) for entry in entries for rival in suite.rivals]


class EncounterStore(Generic[M, R]):
    """Results of encounters, each with the key of its encounter.

    Args:
        kind: a model of the rows.
        path: the file, which need not exist; None: the rows are kept in memory.
    """

    def __init__(self, kind: type[R], path: Path | None = None) -> None:
        self.path = path
        self._kind = kind
        self._file = None if path is None else RowFile(path)
        self._kept: list[R] = []

    def locked(self) -> contextlib.AbstractContextManager[None]:
        """Hold the store for this process; raises UserError while another one holds it."""
        return contextlib.nullcontext() if self._file is None else self._file.locked()

    def records(self, on_invalid: Callable[[str], None] | None = None) -> list[R]:
        """Return all rows.

        Args:
            on_invalid: called with a message for each invalid row, which is left out; None: raise.

        Raises:
            UserError: an invalid row.
        """
        if self._file is None:
            return list(self._kept)
        results = []
        for number, row in enumerate(self._file.read(on_invalid), 1):
            try:
                results.append(self._kind.read(row, f"{self.path}: row {number}"))
            except UserError as error:
                if on_invalid is None:
                    raise
                on_invalid(str(error))
        return results

    def add(self, result: R) -> None:
        """Append a result."""
        if self._file is None:
            self._kept.append(result)
        else:
            self._file.append([result.row()])

    def write(self, results: Iterable[R]) -> None:
        """Replace all rows of the file."""
        assert self._file is not None
        self._file.replace([result.row() for result in results])

    def known(self, on_invalid: Callable[[str], None] | None = None) -> dict[Hashable, R]:
        """Return the rows by their keys, the newest of each; see :meth:`records`."""
        return {result.key: result for result in self.records(on_invalid)}

    def missing(self, wanted: Iterable[M]) -> list[M]:
        """Return the encounters that have no row, each once."""
        known = self.known()
        return list({each.key: each for each in wanted if each.key not in known}.values())

    def play(
        self, wanted: Iterable[M], by: Callable[[M], R], workers: Workers | int = 1, level: int = logging.INFO
    ) -> dict[str, str]:
        """Play the encounters that have no row, several at once; each row is kept as soon as it is there.

        Args:
            wanted: the encounters.
            by: plays one of them.
            workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.
            level: logging level of the line for each that ends.

        Returns:
            The errors of encounters that failed, by their names.
        """
        jobs = [Job(each.name, partial(by, each), self.add) for each in self.missing(wanted)]
        return run_jobs(jobs, workers, level)

    def of(self, wanted: Sequence[M]) -> list[R]:
        """Return the rows of encounters, in their order; raises UserError where one is missing."""
        known = self.known()
        for each in wanted:
            if each.key not in known:
                raise UserError(f"records {self.path}: none of {each.name}; play it first")
        return [known[each.key] for each in wanted]


class Store(EncounterStore[Pairing, Record]):
    """Records of pairings.

    >>> from fpg_bench.evaluation.entry import player_entry
    >>> from fpg_bench.evaluation.evaluate import with_matches
    >>> from fpg_bench.evaluation.suite import load_suite
    >>> wanted = pairings([player_entry("expert")], with_matches(load_suite("ally-v2"), 1))
    >>> store = Store()
    >>> len(store.fill(wanted)), store.missing(wanted)
    (10, [])

    Args:
        path: the file, which need not exist; None: the records are kept in memory.
    """

    def __init__(self, path: Path | None = None) -> None:
        super().__init__(Record, path)

    def records(self, on_invalid: Callable[[str], None] | None = None) -> list[Record]:
        """Return all records, each pairing there once; raises UserError for an invalid row."""
        if self._file is None:
            return list(self._kept)
        try:
            return read_records(self._file.read(on_invalid), f"records {self.path}")
        except UserError as error:
            raise UserError(f"{error}; without its line it is played again") from error

    def claim(self, wanted: Iterable[Pairing], replayed: Collection[str] = ()) -> None:
        """Refuse to mix: raise UserError unless all records are of these suites, and of these players.

        A player of the same name and training seed must be the same player, and a name has training seeds or
        none; other names may be there.

        Args:
            wanted: the pairings.
            replayed: names of players whose records are dropped.
        """
        wanted = list(wanted)
        suites = {pairing.suite.hash[:16] for pairing in wanted}
        players = {(each.name, each.training_seed): each.fingerprint[:16] for each, *_ in wanted}
        seeded = {each.name: each.training_seed is not None for each, *_ in wanted}
        records = self.records()
        kept = [record for record in records if record.entry not in replayed]
        for record in kept:
            if record.suite_hash not in suites:
                raise other_content(f"records {self.path}", f"some of another suite ({record.suite})")
            known = players.get((record.entry, record.training_seed), record.fingerprint)
            is_seeded = record.training_seed is not None
            if known != record.fingerprint or seeded.get(record.entry, is_seeded) != is_seeded:
                raise other_content(
                    f"records {self.path}",
                    f"records of another {record.entry!r} (another policy, or its file has changed)",
                    "give this one another name",
                )
        there = {(record.entry, record.training_seed): record.fingerprint for record in kept}
        policies: dict[str, dict[int | None, str]] = {}
        for (name, seed), policy in (there | players).items():
            policies.setdefault(name, {})[seed] = policy
        check_distinct(policies)
        if len(kept) < len(records):
            self.write(kept)

    def fill(
        self,
        wanted: Sequence[Pairing],
        by: Callable[..., Record] | None = None,
        *,
        progress: Progress = lambda entry, rival, rounds, done, total: None,
        workers: Workers | int = 1,
    ) -> list[Record]:
        """Play the pairings that have no record; each record is kept as soon as it is there.

        Args:
            wanted: the pairings.
            by: plays one of them; None: :func:`fpg_bench.evaluation.play.play`, whose arguments it takes.
            progress: called before each pairing and after each of its rounds, if there is one job.
            workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.

        Returns:
            The records of all these pairings, in their order.

        Raises:
            UserError: a pairing that cannot be played, an invalid row, or another process fills the store.
        """
        with self.locked():
            missing, by = self.missing(wanted), by or play
            if Workers.of(workers).is_alone:
                done, total = 0, sum(suite.rounds_per_match for _, suite, _ in missing)
                for pairing in missing:
                    note = partial(_report, progress, pairing, done, total)
                    note(0)
                    self.add(by(*pairing, on_round=note))
                    done += pairing.suite.rounds_per_match
            else:
                jobs = [Job(each.name, partial(by, *each), self.add) for each in missing]
                check_all_done(run_jobs(jobs, workers))
            return self.of(wanted)


def _report(progress: Progress, pairing: Pairing, before: int, total: int, rounds: int) -> None:
    """Call ``progress`` after some rounds of a pairing, given the rounds before it and the total."""
    progress(pairing.entry, pairing.rival, rounds, before + rounds, total)
