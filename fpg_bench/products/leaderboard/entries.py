"""Entries of a board, read once: its tables, rounds to watch and pages are made of what is read here."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fpg_bench.common.errors import nearest
from fpg_bench.products.leaderboard.cases import Case, Refused, board_reader, read_cases, shared_players
from fpg_bench.products.leaderboard.crossplay import CrossplayEntry, Pairs, players_of, read_pairs
from fpg_bench.products.leaderboard.exploited import Attack, known_attacks
from fpg_bench.products.leaderboard.folders import ANSWERED, TRACK_FOLDERS, short_path
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import TrackSuites

_logger = logging.getLogger(__name__)

_LONGEST_REASON = 300


@dataclass(frozen=True)
class Entries:
    """Everything that a board shows, as it was read.

    Attributes:
        suites: the suites of the tracks.
        verified: submissions with a verified result.
        rejected: readable submissions, each with the reason why its result does not count.
        pairs: results of cross-play.
        attacks: responses to the allies, by ``track/slug``.
        shared: other entries that play the same, by ``track/slug``.
    """

    suites: TrackSuites
    verified: Sequence[Case]
    rejected: Sequence[tuple[Submission, str]]
    pairs: Pairs
    attacks: Mapping[str, tuple[Attack, ...]] = field(default_factory=dict)
    shared: Mapping[str, Sequence[str]] = field(default_factory=dict)


def load_entries(folder: str | Path = "leaderboard") -> Entries:
    """Read a leaderboard's folder: submissions, results, cross-play and responses.

    A submission without a result is left out; one with a result that does not fit it is not verified.

    Args:
        folder: the leaderboard's folder.

    Raises:
        UserError: no such folder, or a file of it that cannot be read.
    """
    folder = Path(folder)
    reader = board_reader(folder)
    cases, rejected = list[Case](), list[tuple[Submission, str]]()
    for path in sorted((folder / "submissions").glob("[!.]*/")):
        if path.name not in TRACK_FOLDERS:
            hint = nearest(path.name, TRACK_FOLDERS)
            _logger.info(f"submissions/{path.name}: left out: not a track{hint}")
    for case in read_cases(folder, reader=reader, inspect_onnx=False):
        if isinstance(case, Refused):
            _logger.info(f"{case.name}: left out: {case.line}")  # nothing of it can be trusted
        elif (failure := _failure_reason(case)) is not None:
            rejected.append((case.submission, failure))
            _logger.info(f"{case.name}: not verified: {failure}")
        elif case.is_verified:
            cases.append(case)
        else:
            place = short_path(case.submission.folder)
            _logger.info(f"{case.name}: left out: has no result; make it: fpg-bench submit run {place}")
    targets = [CrossplayEntry.of(case) for case in cases if case.submission.track == ANSWERED]
    return Entries(
        reader.suites,
        cases,
        rejected,
        read_pairs(folder, players_of(cases)),
        known_attacks(folder, targets),
        shared_players(cases),
    )


def _failure_reason(case: Case) -> str | None:
    """Return the reason why the result of a case does not count, as printable text; None if it does."""
    reason = case.failure
    if case.result is not None:
        reason = reason or case.result.reason
    if reason is None:
        return None
    return "".join(letter if letter.isprintable() else " " for letter in reason[:_LONGEST_REASON])
