"""Verified entries as the targets of responses."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import Suite
from fpg_bench.products.leaderboard.crossplay import CrossplayEntry
from fpg_bench.products.leaderboard.folders import ANSWERED, submission_folders
from fpg_bench.products.leaderboard.playing import Part
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import PUBLIC
from fpg_bench.products.leaderboard.verdicts import Verdicts
from fpg_bench.products.leaderboard.verification import board_reader, load_case

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Target:
    """A verified entry that responses are played against.

    Attributes:
        entry: the entry as a player, in the game of its table.
    """

    entry: CrossplayEntry

    @classmethod
    def of(cls, submission: Submission, public: Suite) -> Target:
        """Return the target of a submission that plays this public suite."""
        return cls(CrossplayEntry.of(submission, public, ""))

    @property
    def name(self) -> str:
        """Its name on the board, ``track/slug``."""
        return f"{self.side}/{self.entry.slug}"

    @property
    def side(self) -> str:
        """Its side."""
        return self.entry.side

    @property
    def parts(self) -> tuple[Part, ...]:
        """Its training seeds, or its script."""
        return self.entry.parts


def answered_entries(
    board: Path, names: Sequence[str], verdicts: Verdicts | None = None, every: bool = False
) -> Iterator[Target]:
    """Yield the verified allies of a board that have responses.

    Args:
        board: the leaderboard's folder.
        names: the entries, ``track/name`` each; empty: all.
        verdicts: where orphans get a bad verdict; None: nowhere.
        every: yield those without responses, too.
    """
    folders = {
        f"{folder.parent.name}/{folder.name}": folder
        for folder in submission_folders(board, names)
        if folder.parent.name == ANSWERED
    }
    answered = {f"{path.parent.name}/{path.name}" for path in (board / "responses").glob("*/[!.]*")}
    if verdicts is not None and not names:
        for name in sorted(answered - folders.keys()):
            verdicts.give(name, False, f"responses/{name}: no such ally")
    reader = board_reader(board)
    for name, folder in folders.items():
        if not (every or name in answered):
            continue
        try:
            case = load_case(board, folder, reader=reader)
        except (UserError, OSError) as error:  # leaderboard verify gives the verdict
            _logger.info(f"{name}: left out: {error}")
            continue
        if case.result is None or not case.result.verified:
            _logger.info(f"{name}: left out: it has no verified result; fpg-bench leaderboard verify {name}")
        else:
            yield Target.of(case.submission, case.suites[PUBLIC])
