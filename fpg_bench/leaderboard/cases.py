"""What is to be verified: submissions with their results, and which of their lines are played (again)."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import math
import random
import shutil
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.suite import Suite
from fpg_bench.leaderboard.check import load_submission, taken
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.playing import Key, Matchup, Part, key_of, matchups_of, parts_of
from fpg_bench.leaderboard.result import Result, differing, fingerprint, read_result
from fpg_bench.leaderboard.submission import TRACKS, Submission

_SUBMITTED = {"submission", "policies", "planner"}  # what of a fingerprint comes from the submission's folder


@dataclass(frozen=True)
class Case:
    """A submission to be verified.

    Attributes:
        submission: whose.
        suites: what it plays, by what that says.
        path: where its result lies, or shall lie.
        known: its result, None where there is none that counts.
        work: the folder of what is under way.
        wanted: whom each of its parts meets.
        claimed: where the result lies that came along with it and is not believed; None: it is believed.
    """

    submission: Submission
    suites: dict[str, Suite]
    path: Path
    known: Result | None
    work: Path
    wanted: tuple[tuple[Part, tuple[Matchup, ...]], ...]
    claimed: Path | None = None

    @property
    def name(self) -> str:
        """What lines about it call it."""
        return f"{self.submission.track}/{self.submission.slug}"

    @property
    def printed(self) -> Row:
        """The fingerprint of what is played."""
        return fingerprint(self.submission, self.suites)

    @property
    def whole(self) -> bool:
        """Whether all of it is wanted."""
        return sum(len(matchups) for _, matchups in self.wanted) == len(_pairs(self))


def submission_folders(board: Path, names: Sequence[str] = ()) -> list[Path]:
    """The folders of a board's submissions, sorted by track and name.

    Args:
        board: the leaderboard's folder.
        names: ``track/name`` each; none: all.

    Raises:
        UserError: no board there, or no submission of that name.
    """
    root = board / "submissions"
    if not root.is_dir():
        raise UserError(f"leaderboard {board}: has no folder submissions")
    found = {
        f"{track}/{folder.name}": folder
        for track in TRACKS
        for folder in sorted((root / track).glob("*"))
        if not folder.name.startswith(".")
    }
    for name in names:
        if name not in found:
            elsewhere = [other for other in found if other.partition("/")[2] == name.partition("/")[2]]
            hint = f"; did you mean {elsewhere[0]!r}?" if elsewhere else nearest(name, found)
            raise UserError(f"no submission {name!r} in {root}{hint}")
    return [found[name] for name in (sorted(set(names)) or found)]


def result_file(board: Path, track: str, slug: str) -> Path:
    """Where a submission's result lies."""
    return board / "results" / track / f"{slug}.jsonl"


def make_case(board: Path, folder: Path, update: bool = False, new: Collection[str] = ()) -> Case:
    """The case of a submission's folder, checked wholly; see :func:`entered` and :func:`case_of`."""
    return case_of(board, entered(board, folder, new=new), update)


def entered(board: Path, folder: Path, contract: bool = True, new: Collection[str] = ()) -> Submission:
    """The submission of a board's folder, whose name no earlier one has.

    Earlier is what is not new, then what has a result, then what comes first by its folder's name.

    Args:
        board: the leaderboard's folder.
        folder: the submission's.
        contract: whether to check what its policies hold, too.
        new: the submissions, ``track/name``, that came or changed.

    Raises:
        UserError: the first thing that is wrong with it.
    """
    submission = load_submission(folder, contract)
    track = submission.track

    def place(name: str) -> tuple[bool, bool, str]:
        return f"{track}/{name}" in new, not result_file(board, track, name).exists(), name

    for name, record in taken(submission):
        if place(name) < place(submission.slug):
            raise UserError(f"submission {folder}: {record}")
    return submission


def set_aside(board: Path, track: str, slug: str) -> Path:
    """Take a result that is not believed off the board, whatever it is; where it lies then, if it was."""
    path = result_file(board, track, slug)
    aside = result_file(work_folder(board) / "claimed", track, slug)
    if path.is_symlink() or path.exists():
        forget(aside)
        aside.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(path, aside)
    return aside


def forget(path: Path) -> None:
    """Remove what :func:`set_aside` has put there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


def case_of(board: Path, submission: Submission, update: bool = False) -> Case:
    """A submission with its result, all of which is to be played.

    Args:
        board: the leaderboard's folder.
        submission: one that it holds.
        update: take a result that does not fit for none.

    Raises:
        UserError: a result that is edited, or of something else.
    """
    suites = submission.suites
    path = result_file(board, submission.track, submission.slug)
    try:
        known = result_at(path, submission, suites)
    except UserError:
        if not update:
            raise
        known = None
    everything = tuple(matchups_of(suites.values()))
    wanted = tuple((part, everything) for part in parts_of(submission))
    return Case(submission, suites, path, known, _work(board, submission, suites), wanted)


def result_at(path: Path, submission: Submission, suites: dict[str, Suite]) -> Result | None:
    """The result of just this submission on just these suites, None where there is no file.

    Raises:
        UserError: a result that is edited, or of something else.
    """
    if not path.exists() and not path.is_symlink():
        return None
    found = read_result(path, suites)
    others = differing(found.fingerprint, fingerprint(submission, suites))
    if not others:
        return found
    if set(others) <= _SUBMITTED:
        what = "transcript" if submission.transcripts else "policy"
        raise UserError(
            f"submission.yaml or a {what} changed since this result was made; {again(submission)}"
        )
    raise UserError(f"result {path}: of other {', '.join(others)}; {again(submission)}")


def again(submission: Submission) -> str:
    """What makes a result anew, in words."""
    return f"make it again: fpg-bench submit run --update {brief(submission.folder)}"


def work_folder(board: Path) -> Path:
    """A folder for what is under way, outside the repository, that nobody's submission can bring along."""
    checkout = hashlib.sha256(str(board.resolve()).encode()).hexdigest()[:12]
    return platformdirs.user_cache_path("fpg_bench") / "leaderboard" / checkout


@contextlib.contextmanager
def at_work(board: Path) -> Iterator[None]:
    """Hold what is under way on a board for this process alone.

    Raises:
        UserError: another process is at work on the board.
    """
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(RowFile(work_folder(board) / "at-work").locked())
        except UserError as error:
            raise UserError(f"leaderboard {board}: another process plays it; wait for its end") from error
        yield


def _work(board: Path, submission: Submission, suites: dict[str, Suite]) -> Path:
    printed = fingerprint(submission, suites)
    played = hashlib.sha256(repr(sorted(printed.items(), key=str)).encode()).hexdigest()[:16]
    return work_folder(board) / submission.track / f"{submission.slug}-{played}"


def check_share(share: float) -> None:
    """Raise UserError for a share that is not above 0 and at most 1."""
    if not 0 < share <= 1:
        raise UserError(f"sample: expected a share above 0 and at most 100 %, got {100 * share:g} %")


def sampled(cases: Iterable[Case], share: float, seed: int) -> list[Case]:
    """Of results that are there, some lines drawn at random, at least one of each; all of those that are not.

    Args:
        cases: what could be played.
        share: of all lines, above 0 and at most 1.
        seed: of the draw.
    """
    cases, rng = list(cases), random.Random(seed)
    records = [
        (number, *pair)
        for number, case in enumerate(cases)
        if case.known is not None and case.known.verified
        for pair in _pairs(case)
    ]
    drawn = set(rng.sample(records, math.ceil(share * len(records))))
    for number in sorted({record[0] for record in records} - {record[0] for record in drawn}):
        drawn.add(rng.choice([record for record in records if record[0] == number]))
    return [
        _thinned(case, {record[1:] for record in drawn if record[0] == k}) for k, case in enumerate(cases)
    ]


def _pairs(case: Case) -> list[tuple[str, Key]]:
    """All that could be played of a case, by the names of part and meeting."""
    matchups = matchups_of(case.suites.values())
    return [(part.name, key_of(*matchup)) for part in parts_of(case.submission) for matchup in matchups]


def _thinned(case: Case, drawn: set[tuple[str, Key]]) -> Case:
    if case.known is None:
        return case
    left = (
        (part, tuple(m for m in matchups if (part.name, key_of(*m)) in drawn))
        for part, matchups in case.wanted
    )
    return dataclasses.replace(case, wanted=tuple((part, matchups) for part, matchups in left if matchups))
