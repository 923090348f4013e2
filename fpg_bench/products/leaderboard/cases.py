"""Cases: the submissions of a board with their results, read in one loop."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import line_on
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.suite import Suite
from fpg_bench.evaluation.summary import Summary, TrainingCost
from fpg_bench.products.leaderboard.folders import result_file, short_path, submission_folders, work_folder
from fpg_bench.products.leaderboard.playing import Matchup, Part, matchups_of, parts_of, suites_of
from fpg_bench.products.leaderboard.result import Fingerprint, Result, fingerprint, read_result, summaries_of
from fpg_bench.products.leaderboard.submission import Reader, Submission, admit
from fpg_bench.products.leaderboard.tracks import PUBLIC, Track, TrackSuites

_SUBMITTED = {"submission", "policies", "planner"}  # keys of a fingerprint that depend on the submission


@dataclass(frozen=True)
class Case:
    """A submission with its result.

    Attributes:
        submission: the submission.
        suites: the suites that it plays, by role.
        fingerprint: of the submission on these suites.
        path: the file of its result.
        result: its result; None if there is none that counts.
        work: the folder of unfinished work.
        wanted: the matchups of each of its parts that are to be played.
        claimed: the file of an untrusted result that came along with it; None if its result is trusted.
        failure: why its result does not count; None if it does, or if there is none.
    """

    submission: Submission
    suites: Mapping[str, Suite]
    fingerprint: Fingerprint
    path: Path
    result: Result | None
    work: Path
    wanted: tuple[tuple[Part, tuple[Matchup, ...]], ...]
    claimed: Path | None = None
    failure: str | None = None

    @property
    def name(self) -> str:
        """Name in messages: ``track/slug``."""
        return f"{self.submission.track}/{self.submission.slug}"

    @property
    def slug(self) -> str:
        """Name of its folder."""
        return self.submission.slug

    @property
    def track(self) -> Track:
        """The track of the board that it is in."""
        return self.submission.board_track

    @property
    def key(self) -> tuple[str, str]:
        """The keys of its track and of itself."""
        return self.track.key, self.slug

    @property
    def is_verified(self) -> bool:
        """True if it has a verified result."""
        return self.result is not None and self.result.verified

    @property
    def records(self) -> tuple[Record, ...]:
        """The records of its result."""
        return () if self.result is None else self.result.records

    @cached_property
    def summaries(self) -> Mapping[str, Summary]:
        """Summaries of its records, by role of the suite."""
        training = TrainingCost(is_search=self.submission.is_search)
        found = summaries_of(self.records, self.suites)
        return {role: dataclasses.replace(of, training=training) for role, of in found.items()}

    @property
    def is_complete(self) -> bool:
        """True if everything that it could play is wanted."""
        n_all = len(parts_of(self.submission)) * len(matchups_of(self.suites.values()))
        return sum(len(matchups) for _, matchups in self.wanted) == n_all


@dataclass(frozen=True)
class Refused:
    """A folder of a board that is no valid submission.

    Attributes:
        name: ``track/slug``.
        line: the first of its problems.
    """

    name: str
    line: str


def read_cases(
    board: Path,
    names: Sequence[str] = (),
    reader: Reader | None = None,
    *,
    inspect_onnx: bool = True,
    update: bool = False,
    caught: tuple[type[Exception], ...] = (UserError, OSError),
) -> Iterator[Case | Refused]:
    """Yield the submissions of a board, by track and name.

    Args:
        board: the leaderboard's folder.
        names: ``track/name`` each; empty: all.
        reader: see :func:`board_reader`.
        inspect_onnx: inspect each of their ONNX files; not needed if none is played.
        update: leave out results that do not fit.
        caught: what refuses a submission: what its files can cause, for all else is a bug of ours.

    Raises:
        UserError: no such board or submission.
    """
    reader = reader or board_reader(board)
    for folder in submission_folders(board, names):
        try:
            submission = admit(folder, reader, inspect_onnx)
            yield make_case(board, submission, reader.suites, update)
        except caught as error:
            yield Refused(f"{folder.parent.name}/{folder.name}", line_on(error))


def verified_cases(board: Path, names: Sequence[str] = ()) -> list[Case]:
    """Return the submissions of a board with a verified result; see :func:`read_cases`."""
    cases = read_cases(board, names, inspect_onnx=False)
    return [case for case in cases if isinstance(case, Case) and case.is_verified]


def board_reader(board: Path, new: Collection[str] = ()) -> Reader:
    """Return the reader of a board's submissions.

    Of entries with the same name, those that are not new take precedence, then those with a result; others
    are in the order of their folders.

    Args:
        board: the leaderboard's folder.
        new: the submissions, ``track/name``, that are new or have changed.
    """

    def precedence(folder: Path) -> tuple[bool, bool, str]:
        track, slug = folder.parent.name, folder.name
        return f"{track}/{slug}" in new, not result_file(board, track, slug).exists(), slug

    return Reader(precedence)


def make_case(board: Path, submission: Submission, suites: TrackSuites, update: bool = False) -> Case:
    """Return a submission with its result; everything that it plays is wanted.

    Args:
        board: the leaderboard's folder.
        submission: one of its submissions.
        suites: the suites of the tracks.
        update: ignore a result that does not fit.

    Raises:
        UserError: its transcripts cannot be read.
    """
    played = suites_of(submission, suites)
    expected = fingerprint(submission, played)
    path = result_file(board, submission.track, submission.slug)
    result = failure = None
    try:
        result = result_at(path, submission, played, expected)
    except UserError as error:
        failure = None if update else str(error)
    digest = hashlib.sha256(expected.model_dump_json().encode()).hexdigest()[:16]
    work = work_folder(board) / submission.track / f"{submission.slug}-{digest}"
    everything = tuple(matchups_of(played.values()))
    wanted = tuple((part, everything) for part in parts_of(submission))
    return Case(submission, played, expected, path, result, work, wanted, failure=failure)


def shared_players(cases: Iterable[Case]) -> dict[str, list[str]]:
    """Return the other entries that have one of an entry's players, by the entry's name.

    Players are the same if their files, transcripts or scripts are, or if every public round was the same to
    the bit. Authors may enter theirs in several tables of the board.
    """
    owners: dict[object, list[Case]] = {}
    for case in cases:
        for identity in set(_identities(case)):
            owners.setdefault(identity, []).append(case)
    shared: dict[str, set[str]] = {}
    for sharing in owners.values():
        for one, other in itertools.permutations(sharing, 2):
            is_same_table = one.submission.board_track is other.submission.board_track
            if is_same_table or one.submission.authors != other.submission.authors:
                shared.setdefault(one.name, set()).add(other.name)
    return {name: sorted(others) for name, others in shared.items()}


def _identities(case: Case) -> Iterator[object]:
    by_seed: dict[int | None, list[tuple[str, str, str]]] = {}
    for record in case.records:
        if record.suite_hash == case.suites[PUBLIC].hash[:16]:
            played = record.suite_hash, record.rival, record.rounds_sha256
            by_seed.setdefault(record.training_seed, []).append(played)
    submission = case.submission
    yield from (policy.sha256 for policy in submission.policies)
    yield from (tuple(sorted(played)) for played in by_seed.values())
    if submission.script is not None:
        yield submission.track, submission.script
    if submission.transcripts:
        yield tuple(hashlib.sha256(path.read_bytes()).hexdigest() for path in submission.transcripts)


def result_at(
    path: Path, submission: Submission, suites: Mapping[str, Suite], expected: Fingerprint
) -> Result | None:
    """Read the result of just this submission on just these suites; None if there is no file.

    Raises:
        UserError: the result was edited, or is of another submission or of other suites.
    """
    if not path.exists() and not path.is_symlink():
        return None
    result = read_result(path, suites)
    differing = result.fingerprint.differences(expected)
    if not differing:
        return result
    if set(differing) <= _SUBMITTED:
        changed = "transcript" if submission.transcripts else "policy"
        raise UserError(
            f"submission.yaml or a {changed} changed since this result was made; {rerun_hint(submission)}"
        )
    raise UserError(f"result {path}: of other {', '.join(differing)}; {rerun_hint(submission)}")


def rerun_hint(submission: Submission) -> str:
    """Return how a result is made again."""
    return f"make it again: fpg-bench submit run --update {short_path(submission.folder)}"
