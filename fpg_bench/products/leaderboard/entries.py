"""Entries of a board, read once: its tables, rounds to watch and pages are made of what is read here."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.evaluation.suite import Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.products.leaderboard.crossplay import Pairs, players_of, read_pairs
from fpg_bench.products.leaderboard.exploited import Attack, known_attacks
from fpg_bench.products.leaderboard.folders import (
    ANSWERED,
    TRACK_FOLDERS,
    result_file,
    short_path,
    submission_folders,
)
from fpg_bench.products.leaderboard.result import Result, summaries_of
from fpg_bench.products.leaderboard.submission import Reader, Submission
from fpg_bench.products.leaderboard.targets import Target
from fpg_bench.products.leaderboard.tracks import PUBLIC, Track, TrackSuites
from fpg_bench.products.leaderboard.verification import (
    Case,
    board_reader,
    load_entry,
    make_case,
    shared_policies,
)

_logger = logging.getLogger(__name__)

_LONGEST_REASON = 300


@dataclass(frozen=True)
class VerifiedEntry:
    """A submission with a verified result.

    Attributes:
        suites: the suites that it plays, by role.
        summaries: of its records, by role.
        same_policies: other entries, ``track/slug``, that have one of its policies.
    """

    submission: Submission
    suites: Mapping[str, Suite]
    result: Result
    summaries: Mapping[str, Summary]
    same_policies: tuple[str, ...] = ()

    @property
    def slug(self) -> str:
        """Name of its folder."""
        return self.submission.slug

    @property
    def track(self) -> Track:
        """The track of the board that it is in."""
        return self.submission.board_track

    @cached_property
    def key(self) -> tuple[str, str]:
        """The keys of its track and of itself."""
        return self.track.key, self.slug


@dataclass(frozen=True)
class Entries:
    """Everything that a board shows, as it was read.

    Attributes:
        suites: the suites of the tracks.
        rejected: readable submissions, each with the reason why its result does not count.
        pairs: results of cross-play.
        attacks: responses to the allies, by ``track/slug``.
    """

    suites: TrackSuites
    verified: Sequence[VerifiedEntry]
    rejected: Sequence[tuple[Submission, str]]
    pairs: Pairs
    attacks: Mapping[str, tuple[Attack, ...]] = field(default_factory=dict)


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
    cases, rejected = _read_cases(folder, reader)
    shared = shared_policies(cases)
    verified = [
        VerifiedEntry(
            case.submission,
            case.suites,
            case.result,
            summaries_of(case.result.records, case.suites),
            tuple(shared.get(case.name, ())),
        )
        for case in cases
        if case.result is not None
    ]
    targets = [
        Target.of(case.submission, case.suites[PUBLIC]) for case in cases if case.submission.track == ANSWERED
    ]
    return Entries(
        reader.suites,
        verified,
        rejected,
        read_pairs(folder, players_of(cases)),
        known_attacks(folder, targets),
    )


def _read_cases(board: Path, reader: Reader) -> tuple[list[Case], list[tuple[Submission, str]]]:
    """Return the verified submissions of a board, and those whose results do not count."""
    cases: list[Case] = []
    rejected: list[tuple[Submission, str]] = []
    for path in sorted((board / "submissions").glob("[!.]*/")):
        if path.name not in TRACK_FOLDERS:
            hint = nearest(path.name, TRACK_FOLDERS)
            _logger.info(f"submissions/{path.name}: left out: not a track{hint}")
    for folder in submission_folders(board):
        name = f"{folder.parent.name}/{folder.name}"
        if not result_file(board, folder.parent.name, folder.name).exists():
            _logger.info(
                f"{name}: left out: has no result; make it: fpg-bench submit run {short_path(folder)}"
            )
            continue
        try:
            submission = load_entry(folder, reader, inspect_onnx=False)
        except (UserError, OSError) as error:  # what its files can cause; all else is a bug of ours
            _logger.info(f"{name}: left out: {error}")  # nothing of it can be trusted, not even its name
            continue
        try:
            case = make_case(board, submission, reader.suites)
            failure = _failure_reason(case)
        except (UserError, OSError) as error:
            failure = str(error)
        if failure is None:
            cases.append(case)
        else:
            rejected.append((submission, failure))
            _logger.info(f"{name}: not verified: {failure}")
    return cases, rejected


def _failure_reason(case: Case) -> str | None:
    """Return the reason why a case is not verified, as printable text; None if its result is verified."""
    if case.result is None or case.result.reason is None:
        return None
    reason = case.result.reason[:_LONGEST_REASON]
    return "".join(letter if letter.isprintable() else " " for letter in reason)
