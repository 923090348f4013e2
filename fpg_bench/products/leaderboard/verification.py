"""Verification: submissions are played, or played again and compared with their results."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import math
import random
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from fpg_bench.common.errors import UserError, meant
from fpg_bench.common.parallel import Job, Workers, folder_job, outcome_of, run_jobs
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.suite import Suite
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.products.leaderboard.cases import (
    Case,
    Refused,
    board_reader,
    read_cases,
    rerun_hint,
    result_at,
    shared_players,
)
from fpg_bench.products.leaderboard.changed_entries import changed_entries
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.folders import TRACK_FOLDERS, at_work, remove, set_aside, short_path
from fpg_bench.products.leaderboard.playing import Key, Matchup, Part, PlayedPart, fill, key_of, read_part
from fpg_bench.products.leaderboard.result import Result, write_result
from fpg_bench.products.leaderboard.tracks import ranked_by
from fpg_bench.products.leaderboard.verdicts import RECORD, Verdict, Verdicts, check_share, judge, replays_of

_logger = logging.getLogger(__name__)


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
        if case.is_verified
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
            return False, f"the result is not verified, but it plays; {rerun_hint(case.submission)}"
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
    read = outcome_of(partial(result_at, claimed, case.submission, case.suites, case.fingerprint))
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
    how: Verification = Verification(),  # noqa: B008
    changes_known: bool = False,
) -> list[Verdict]:
    """Verify submissions; one with problems does not stop the others.

    A submission without a result is played and its result written. Any other is played again and compared
    with its result. An interrupted verification is resumed. Of a sample, at least one record per submission
    is played.

    Args:
        board: the leaderboard's folder.
        how: which are played again. With ``since``, entries whose submission or result differs are played in
            full, whatever the sample, and the results that came along are compared.
        changes_known: accept that other files changed since, too.

    Returns:
        The verdicts, by track and name.

    Raises:
        UserError: no such board or submission, a share out of range, unknown changes, or no cluster.
    """
    if how.sample is not None:
        check_share(how.sample)
    board = Path(board)
    new = frozenset() if how.since is None else _new_entries(board, how.since, changes_known)
    with at_work(board):
        verification = _Verification(board, new)
        cases = verification.cases(how.names, how.update)
        if how.sample is not None:
            seed = random.SystemRandom().randrange(2**32) if how.seed is None else how.seed
            _logger.info(f"sample: {100 * how.sample:g} % of all records, --sample-seed {seed}")
            cases = draw_sample(cases, how.sample, seed)
        elif how.since is not None and not how.names:
            cases = verification.changed(cases, how.since)
        if not how.names:
            verification.check_orphans()
        every = [job for case in cases for job in verification.jobs(case)]
        verification.failed |= run_jobs(every, how.workers, level=logging.DEBUG)
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
    return changes.entries


class _Verification:
    """Collects verdicts; each submission is settled as soon as its last record is there."""

    def __init__(self, board: Path, new: Collection[str]) -> None:
        self.verdicts = Verdicts()
        self.failed: dict[str, str] = {}
        self._board, self._new = board, new
        self._shared: dict[str, list[str]] = {}

    def cases(self, names: Sequence[str], update: bool) -> list[Case]:
        """Return the named cases; those that are wrong, or gone, get their verdicts."""
        aside = {name: outcome_of(partial(set_aside, self._board, *name.split("/"))) for name in self._new}
        for name in sorted(self._new):
            if not (self._board / "submissions" / name).is_dir():
                self.verdicts.give(
                    name, False, "has no submission: it was removed, or only a result was added"
                )
        reader, cases = board_reader(self._board, self._new), list[Case]()
        for case in read_cases(self._board, names, reader, update=update, caught=(Exception,)):
            moved = aside.get(case.name)
            if isinstance(case, Refused):
                self.verdicts.give(case.name, False, case.line)
            elif failure := case.failure or (moved and moved.error):
                self.verdicts.give(case.name, False, failure)
            else:
                cases.append(dataclasses.replace(case, claimed=None if moved is None else moved.result))
        self._shared = shared_players(cases)
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
            line += f"; it plays the same as {', '.join(others)}: ask whose it is"
        self.verdicts.give(case.name, good, line + _missing_isolation(played.result or ()))

    def _keep(self, job: Job, case: Case, result: object) -> None:
        job.keep(result)
        if all(_is_done(case.work / part.name, matchups) for part, matchups in case.wanted):
            self.settle(case)


def _job_name(case: Case, part: Part) -> str:
    return f"{case.name} {part.name}"


def _is_done(folder: Path, matchups: Sequence[Matchup]) -> bool:
    return read_part(folder).is_done(matchups)


def run_one(folder: str | Path, update: bool = False, *, workers: Workers | int = 1) -> Verdict:
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
    (verdict,) = verify(board, Verification([name], update=update, workers=workers))
    return verdict
