"""Verification: submissions are played, or played again and compared with their results."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import logging
import math
import random
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fpg_bench.common.errors import UserError, meant
from fpg_bench.common.parallel import Job, Workers, folder_job, outcome_of, run_jobs
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.suite import Suite
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.products.leaderboard.changed_entries import changed_entries
from fpg_bench.products.leaderboard.folders import (
    TRACK_FOLDERS,
    at_work,
    remove,
    result_file,
    set_aside,
    short_path,
    submission_folders,
    work_folder,
)
from fpg_bench.products.leaderboard.playing import (
    Key,
    Matchup,
    Part,
    PlayedPart,
    fill,
    key_of,
    matchups_of,
    parts_of,
    read_part,
    suites_of,
)
from fpg_bench.products.leaderboard.result import (
    Fingerprint,
    Result,
    fingerprint,
    read_result,
    write_result,
)
from fpg_bench.products.leaderboard.submission import Reader, Submission, load_submission, name_conflicts
from fpg_bench.products.leaderboard.tracks import PUBLIC, TrackSuites, ranked_by
from fpg_bench.products.leaderboard.verdicts import RECORD, Verdict, Verdicts, check_share, judge, replays_of

_logger = logging.getLogger(__name__)

_SUBMITTED = {"submission", "policies", "planner"}  # keys of a fingerprint that depend on the submission


# Cases: submissions with their results


@dataclass(frozen=True)
class Case:
    """A submission to be verified.

    Attributes:
        submission: the submission.
        suites: the suites that it plays, by role.
        fingerprint: of the submission on these suites.
        path: the file of its result.
        result: its result; None if there is none that counts.
        work: the folder of unfinished work.
        wanted: the matchups of each of its parts that are to be played.
        claimed: the file of an untrusted result that came along with it; None if its result is trusted.
    """

    submission: Submission
    suites: Mapping[str, Suite]
    fingerprint: Fingerprint
    path: Path
    result: Result | None
    work: Path
    wanted: tuple[tuple[Part, tuple[Matchup, ...]], ...]
    claimed: Path | None = None

    @property
    def name(self) -> str:
        """Name in messages: ``track/slug``."""
        return f"{self.submission.track}/{self.submission.slug}"

    @property
    def is_complete(self) -> bool:
        """True if everything that it could play is wanted."""
        n_all = len(parts_of(self.submission)) * len(matchups_of(self.suites.values()))
        return sum(len(matchups) for _, matchups in self.wanted) == n_all


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


def load_case(board: Path, folder: Path, update: bool = False, reader: Reader | None = None) -> Case:
    """Load the case of a submission's folder, fully checked; see :func:`load_entry` and :func:`make_case`."""
    reader = reader or board_reader(board)
    return make_case(board, load_entry(folder, reader), reader.suites, update)


def load_entry(folder: Path, reader: Reader, inspect_onnx: bool = True) -> Submission:
    """Load a submission of a board, and check that no entry that takes precedence has its name.

    Args:
        folder: the submission's folder.
        reader: see :func:`board_reader`.
        inspect_onnx: inspect each of its ONNX files.

    Raises:
        UserError: the first of its problems.
    """
    submission = load_submission(folder, inspect_onnx, reader)
    for line in name_conflicts(submission, reader, earlier=True):
        raise UserError(f"submission {folder}: {line}")
    return submission


def make_case(board: Path, submission: Submission, suites: TrackSuites, update: bool = False) -> Case:
    """Return a submission with its result; everything that it plays is wanted.

    Args:
        board: the leaderboard's folder.
        submission: one of its submissions.
        suites: the suites of the tracks.
        update: ignore a result that does not fit.

    Raises:
        UserError: the result was edited, or is of another submission or of other suites.
    """
    played = suites_of(submission, suites)
    expected = fingerprint(submission, played)
    path = result_file(board, submission.track, submission.slug)
    try:
        result = _result_at(path, submission, played, expected)
    except UserError:
        if not update:
            raise
        result = None
    digest = hashlib.sha256(expected.model_dump_json().encode()).hexdigest()[:16]
    work = work_folder(board) / submission.track / f"{submission.slug}-{digest}"
    everything = tuple(matchups_of(played.values()))
    wanted = tuple((part, everything) for part in parts_of(submission))
    return Case(submission, played, expected, path, result, work, wanted)


def shared_policies(cases: Iterable[Case]) -> dict[str, list[str]]:
    """Return the other entries that have one of an entry's policies, by the entry's name.

    Policies are the same if their files are, or if every public round was the same to the bit. Authors may
    enter theirs in several tables of the board.
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
    for record in () if case.result is None else case.result.records:
        if record.suite_hash == case.suites[PUBLIC].hash[:16]:
            played = record.suite_hash, record.rival, record.rounds_sha256
            by_seed.setdefault(record.training_seed, []).append(played)
    for policy in case.submission.policies:
        yield policy.sha256
        if policy.seed in by_seed:
            yield tuple(sorted(by_seed[policy.seed]))


def _result_at(
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
            f"submission.yaml or a {changed} changed since this result was made; {_rerun_hint(submission)}"
        )
    raise UserError(f"result {path}: of other {', '.join(differing)}; {_rerun_hint(submission)}")


def _rerun_hint(submission: Submission) -> str:
    return f"make it again: fpg-bench submit run --update {short_path(submission.folder)}"


# Samples


def draw_sample(cases: Iterable[Case], share: float, seed: int) -> list[Case]:
    """Draw records to be played again at random, at least one per result; cases without result stay whole.

    Args:
        cases: the cases.
        share: of all records, above 0 and at most 1.
        seed: of the draw.
    """
    cases, rng = list(cases), random.Random(seed)
    records = [
        (number, part.name, key_of(*matchup))
        for number, case in enumerate(cases)
        if case.result is not None and case.result.verified
        for part, matchups in case.wanted
        for matchup in matchups
    ]
    drawn = set(rng.sample(records, math.ceil(share * len(records))))
    for number in sorted({record[0] for record in records} - {record[0] for record in drawn}):
        drawn.add(rng.choice([record for record in records if record[0] == number]))
    return [
        _restrict(case, {(part, key) for number, part, key in drawn if number == k})
        for k, case in enumerate(cases)
    ]


def _restrict(case: Case, drawn: set[tuple[str, Key]]) -> Case:
    if case.result is None:
        return case
    left = (
        (part, tuple(matchup for matchup in matchups if (part.name, key_of(*matchup)) in drawn))
        for part, matchups in case.wanted
    )
    return dataclasses.replace(case, wanted=tuple((part, matchups) for part, matchups in left if matchups))


# Verdicts


def _judge(case: Case, played: Sequence[PlayedPart]) -> tuple[bool, str]:
    """Return the verdict on a case that was played; writes the result if there is none."""
    failure = next((part.failure for part in played if part.failure is not None), None)
    records: list[Record] = []
    for part, (_, matchups) in zip(played, case.wanted, strict=True) if failure is None else ():
        records += [part.records[key_of(*matchup)] for matchup in matchups]
    if case.is_complete and records and all(record.lost == len(record.returns) for record in records):
        failure = "all of its rounds are lost by rule: its answers are not valid actions"
    if case.result is None:
        return _judge_first(case, records, failure)
    if not case.result.verified:
        if not case.wanted:
            return True, "not verified; not part of a sample"
        if failure is None:
            return False, f"the result is not verified, but it plays; {_rerun_hint(case.submission)}"
        return True, f"not verified, as before: {failure}"
    if failure is not None:
        return False, f"the result is verified, but now: {failure}"
    replays = replays_of(records, case.result.records, case.suites.values())
    same = sum(RECORD.is_same(each.now, each.then) for each in replays)
    return judge(RECORD.of(replays), f"{same} of {len(records)} records played again are the same to the bit")


def _judge_first(case: Case, records: list[Record], failure: str | None) -> tuple[bool, str]:
    """Write the first result of a case."""
    result = Result(case.submission.slug, case.submission.track, case.fingerprint, reason=failure)
    if failure is None:
        result = dataclasses.replace(result, records=tuple(records))
    write_result(case.path, result)
    if failure is not None:
        return False, f"not verified: {failure}"
    wrong = None if case.claimed is None else _claim_differences(case, case.claimed, records)
    return judge(wrong, _describe(result, case.suites), is_trusted=False)


def _claim_differences(case: Case, claimed: Path, records: list[Record]) -> list[str] | None:
    """Return what does not hold of a result that came along; None if there was none."""
    read = outcome_of(partial(_result_at, claimed, case.submission, case.suites, case.fingerprint))
    if read.error is not None:
        return ["it is not of this entry, or was edited"]
    claim: Result | None = read.result
    if claim is None:
        return None
    if not claim.verified:
        return ["it says that it is not verified"]
    return RECORD.of(replays_of(records, claim.records, case.suites.values()))


def _describe(result: Result, suites: Mapping[str, Suite]) -> str:
    """Return a verified result as one line."""
    role = ranked_by(suites)
    score = summary_of(result.records, suites[role]).score
    lost = sum(record.lost for record in result.records)
    rounds = sum(len(record.returns) for record in result.records)
    lost_text = f", {lost:,} of {rounds:,} rounds lost by rule" if lost else ""
    return f"{role} {score.value:.1f} [{score.low:.1f}, {score.high:.1f}]{lost_text}"


def _missing_isolation(played: Sequence[PlayedPart]) -> str:
    """Return text on what the processes of policies could not be kept from; empty if all was blocked."""
    names = dict.fromkeys(name for part in played for name in part.unprotected)
    return f"; this machine cannot keep a policy from {', '.join(names)}" if names else ""


# Boards


def verify(
    board: str | Path,
    names: Sequence[str] = (),
    *,
    sample: float | None = None,
    sample_seed: int | None = None,
    update: bool = False,
    since: str | None = None,
    changes_known: bool = False,
    workers: Workers | int = 1,
) -> list[Verdict]:
    """Verify submissions; one with problems does not stop the others.

    A submission without a result is played and its result written. Any other is played again and compared
    with its result. An interrupted verification is resumed.

    Args:
        board: the leaderboard's folder.
        names: ``track/name`` each; empty: all.
        sample: play only this share of the records again, drawn at random, at least one per submission.
        sample_seed: of the draw; None: a new one, which is reported.
        update: play again, and replace, results that do not fit the submission or were edited.
        since: a trusted git revision. Entries whose submission or result differs from it are played in full,
            whatever the sample, and their results are replaced; the results that came along are compared. Of
            the others only those that are named, or a sample, are played again.
        changes_known: accept that other files changed since, too.
        workers: number of policies that are played at once, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The verdicts, by track and name.

    Raises:
        UserError: no such board or submission, a share out of range, unknown changes, or no cluster.
    """
    if sample is not None:
        check_share(sample)
    board = Path(board)
    new = frozenset() if since is None else _new_entries(board, since, changes_known)
    with at_work(board):
        verification = _Verification(board, new)
        cases = verification.cases(submission_folders(board, names), update)
        if sample is not None:
            seed = random.SystemRandom().randrange(2**32) if sample_seed is None else sample_seed
            _logger.info(f"sample: {100 * sample:g} % of all records, --sample-seed {seed}")
            cases = draw_sample(cases, sample, seed)
        elif since is not None and not names:
            cases = verification.changed(cases, since)
        if not names:
            verification.check_orphans()
        every = [job for case in cases for job in verification.jobs(case)]
        verification.failed |= run_jobs(every, workers, level=logging.DEBUG)
        for case in cases:
            verification.settle(case)
    return verification.verdicts.all()


def _new_entries(board: Path, since: str, changes_known: bool) -> frozenset[str]:
    """Return the entries that changed since a revision; other changes must be known."""
    changes = changed_entries(board, since)
    if changes.others and not changes_known:
        few = ", ".join(changes.others[:5]) + (", ..." if len(changes.others) > 5 else "")
        raise UserError(
            f"since: {len(changes.others)} files outside of entries have changed: {few}; review them, then "
            "pass --changes-known"
        )
    if changes.has_pairs:
        _logger.info(
            f"pairs of cross-play changed: fpg-bench leaderboard crossplay --since {since} plays them"
        )
    return changes.entries


class _Verification:
    """Collects verdicts; each submission is settled as soon as its last record is there."""

    def __init__(self, board: Path, new: Collection[str]) -> None:
        self.verdicts = Verdicts()
        self.failed: dict[str, str] = {}
        self._board, self._new = board, new
        self._shared: dict[str, list[str]] = {}

    def cases(self, folders: Sequence[Path], update: bool) -> list[Case]:
        """Return the cases of folders; those that are wrong, or gone, get their verdicts."""
        aside = {name: outcome_of(partial(set_aside, self._board, *name.split("/"))) for name in self._new}
        for name in sorted(self._new):
            if not (self._board / "submissions" / name).is_dir():
                self.verdicts.give(
                    name, False, "has no submission: it was removed, or only a result was added"
                )
        reader, cases = board_reader(self._board, self._new), []
        for folder in folders:
            name = f"{folder.parent.name}/{folder.name}"
            read = outcome_of(partial(load_case, self._board, folder, update, reader))
            error = read.error if name not in aside else read.error or aside[name].error
            if error is not None:
                self.verdicts.give(name, False, error)
            else:
                claimed = aside[name].result if name in aside else None
                cases.append(dataclasses.replace(read.result, claimed=claimed))
        self._shared = shared_policies(cases)
        return cases

    def changed(self, cases: Sequence[Case], since: str) -> list[Case]:
        """Return the cases that are new, or without a result; the others hold as they were at a revision."""
        is_kept = [case.result is not None and case.name not in self._new for case in cases]
        for case in itertools.compress(cases, is_kept):
            self.verdicts.give(case.name, True, f"unchanged since {since}, not played again")
        return [case for case, kept in zip(cases, is_kept, strict=True) if not kept]

    def check_orphans(self) -> None:
        """Give a verdict on results whose submission is not there."""
        for track in TRACK_FOLDERS:
            for path in sorted((self._board / "results" / track).glob("*.jsonl")):
                if not (self._board / "submissions" / track / path.stem).is_dir():
                    self.verdicts.give(f"{track}/{path.stem}", False, f"result {path}: no such submission")

    def jobs(self, case: Case) -> Iterator[Job]:
        """Yield a job per part of a case."""
        for part, matchups in case.wanted:
            folder = case.work / part.name
            done = partial(_is_done, folder, matchups)
            job = folder_job(_job_name(case, part), folder, partial(fill, part, matchups), done)
            yield dataclasses.replace(job, keep=partial(self._keep, job, case))

    def settle(self, case: Case) -> None:
        """Give the verdict on a case, unless it was given already."""
        if case.name in self.verdicts:
            return
        names = [_job_name(case, part) for part, _ in case.wanted]
        if errors := [self.failed[name] for name in names if name in self.failed]:
            self.verdicts.give(case.name, False, errors[0])
            return
        played = outcome_of(lambda: [read_part(case.work / part.name) for part, _ in case.wanted])
        judged = played if played.error is not None else outcome_of(partial(_judge, case, played.result))
        if played.error is None and judged.error is not None:  # a full disk, or a folder of somebody else's
            good, line = False, f"{judged.error}; what was played is kept, run it again"
        else:
            shutil.rmtree(case.work, ignore_errors=True)
            if case.claimed is not None:
                remove(case.claimed)
            good, line = judged.result if judged.error is None else (False, judged.error)
        if others := self._shared.get(case.name):
            line += f"; it has a policy of {', '.join(others)}, too: ask whose it is"
        self.verdicts.give(case.name, good, line + _missing_isolation(played.result or ()))

    def _keep(self, job: Job, case: Case, result: object) -> None:
        job.keep(result)
        if all(_is_done(case.work / part.name, matchups) for part, matchups in case.wanted):
            self.settle(case)


def _job_name(case: Case, part: Part) -> str:
    return f"{case.name} {part.name}"


def _is_done(folder: Path, matchups: Sequence[Matchup]) -> bool:
    return read_part(folder).is_done(matchups)


def run_one(
    folder: str | Path,
    update: bool = False,
    *,
    workers: Workers | int = 1,
) -> Verdict:
    """Verify the submission of a folder ``<board>/submissions/<track>/<name>``; see :func:`verify`.

    Raises:
        UserError: a folder elsewhere, or no cluster.
    """
    given, folder = folder, Path(folder).resolve()
    track = folder.parent.name
    if folder.parent.parent.name != "submissions" or track not in TRACK_FOLDERS:
        hint = meant(track, TRACK_FOLDERS) if folder.parent.parent.name == "submissions" else ""
        expected = f"<leaderboard>/submissions/<{'|'.join(TRACK_FOLDERS)}>/<name>"
        raise UserError(f"{given}: expected a folder {expected}{hint}")
    board = Path(short_path(folder.parents[2]))
    name = f"{track}/{folder.name}"
    (verdict,) = verify(board, [name], update=update, workers=workers)
    return verdict
