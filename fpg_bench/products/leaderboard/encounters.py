"""One engine for what a board keeps a row each of: responses to entries, and pairs of cross-play.

Rows are played again and compared; those that are not there, or not trusted, are played and written.
"""

from __future__ import annotations

import logging
import random
from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Workers
from fpg_bench.evaluation.store import EncounterStore, M, R
from fpg_bench.products.leaderboard.changed_entries import rows_at
from fpg_bench.products.leaderboard.playing import work_store
from fpg_bench.products.leaderboard.verdicts import Verdicts, draw, judge

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Verification:
    """Options of a board's verification.

    Attributes:
        names: the entries, ``track/name`` each; empty: all.
        sample: of the results that are trusted, play only this share again; None: all of them.
        seed: of the draw; None: a new one.
        since: a trusted git revision. Results that are not there are not trusted: they are played and
            replaced. Of the others only those of named entries, or a sample, are played.
        update: replace what does not hold without ado.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.
    """

    names: Sequence[str] = ()
    sample: float | None = None
    seed: int | None = None
    since: str | None = None
    update: bool = False
    workers: Workers | int = 1

    @property
    def share(self) -> float:
        """The share of the trusted results that are played again."""
        if self.sample is not None:
            return self.sample
        return 1.0 if self.since is None or self.names else 0.0


@dataclass(frozen=True)
class Kind(Generic[M, R]):
    """A kind of encounters, whose results are the rows of one file of a board.

    Attributes:
        name: of the kind.
        model: of the rows.
        file: returns the path of the file on a board.
        play: plays an encounter.
        compare: returns what does not hold of a stored result, beside that which was just played.
        describe: returns a result in words.
    """

    name: str
    model: type[R]
    file: Callable[[Path], Path]
    play: Callable[[M], R]
    compare: Callable[[M, R, R], list[str]]
    describe: Callable[[M, R], str]

    def read(self, board: Path, on_invalid: Callable[[str], None] | None = None) -> dict[Hashable, R]:
        """Return the results on a board by their keys.

        Args:
            board: the leaderboard's folder.
            on_invalid: called with a message for each row that is left out, as it is no result or was edited;
                None: it is logged.
        """
        note = on_invalid or (lambda line: _logger.info(f"{line}; left out"))
        return EncounterStore[M, R](self.model, self.file(board)).known(note)

    def write(self, board: Path, results: Collection[R]) -> None:
        """Write the results of a board."""
        if results or self.file(board).exists():
            EncounterStore[M, R](self.model, self.file(board)).write(results)

    def trusted(self, board: Path, since: str | None) -> list[R]:
        """Return the results at a git revision; None: all that are on the board."""
        if since is None:
            return list(self.read(board, lambda line: None).values())
        results = []
        for row in rows_at(board, since, self.file):
            try:
                results.append(self.model.read(row, "row"))
            except UserError as error:
                _logger.info(f"{since}: {error}; not trusted")
        return results

    def verify(
        self,
        board: Path,
        wanted: Sequence[M],
        verdicts: Verdicts,
        how: Verification,
        place: Callable[[R], Any],
    ) -> None:
        """Play encounters of a board, and compare with their results or write them.

        Args:
            board: the leaderboard's folder.
            wanted: the encounters.
            verdicts: where verdicts are given.
            how: which are played again.
            place: returns the key by which a result is sorted in the file; None: it is left out.
        """
        work_name = self.name if how.since is None else f"{self.name}-since"
        with work_store(board, work_name, self.model) as work:
            invalid = list[str]()
            known, stays = self.read(board, invalid.append), set(self.trusted(board, how.since))
            if invalid and not how.update:
                others = f" (and {len(invalid) - 1} more)" if len(invalid) > 1 else ""
                line = f"{invalid[0]}{others}; played again and replaced, commit this file"
                verdicts.give(self.file(board).name, False, line)
            kept = [each for each in wanted if known.get(each.key) in stays]
            drawn = {each.key for each in draw(kept, how.share, random.Random(how.seed))}
            spared = {each.key for each in kept} - drawn
            for each in kept:
                if each.key in spared:
                    verdicts.give(each.name, True, "not played again")
            chosen = [each for each in wanted if each.key not in spared]
            failed = work.play(chosen, self.play, how.workers, logging.DEBUG)
            played = work.known()
            for each in chosen:
                if each.name in failed:
                    verdicts.give(each.name, False, f"not verified: {failed[each.name]}")
                    if known.get(each.key) not in stays:
                        known.pop(each.key, None)
                    continue
                now, then = played[each.key], known.get(each.key)
                differing = None if then is None else self.compare(each, now, then)
                if then not in stays or (how.update and differing):
                    known[each.key] = now
                line = self.describe(each, now)
                verdicts.give(each.name, *judge(differing, line, then in stays, how.update))
            rows = [row for row in known.values() if place(row) is not None]
            self.write(board, sorted(rows, key=place))
