"""The verdict: submissions are played, or played again, and compared with the results that are kept."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError, meant, printable
from fpg_bench.evaluation.line import Line
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import Job, attempt, outcome_of
from fpg_bench.jobs.run import run_jobs
from fpg_bench.leaderboard.agreement import disagreements, same_to_the_bit
from fpg_bench.leaderboard.cases import (
    Case,
    again,
    at_work,
    forget,
    make_case,
    result_at,
    sampled,
    set_aside,
    submission_folders,
)
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.likeness import told_apart
from fpg_bench.leaderboard.playing import Meeting, Part, failure_in, fill, key_of, lines_in, open_in
from fpg_bench.leaderboard.result import Result, failed_result, verified_result, write_result
from fpg_bench.leaderboard.since import changes_since
from fpg_bench.leaderboard.submission import TRACKS
from fpg_bench.leaderboard.tracks import ranked_by


@dataclass(frozen=True)
class Verdict:
    """What became of one submission: all is well or not, and the line that says so."""

    name: str
    good: bool
    line: str


def verify(
    board: str | Path,
    names: Sequence[str] = (),
    *,
    sample: float | None = None,
    sample_seed: int | None = None,
    update: bool = False,
    since: str | None = None,
    changes_known: bool = False,
    jobs: int = 1,
    backend: str = "loky",
    address: str | None = None,
    say: Callable[[str], None] = print,
) -> list[Verdict]:
    """Verify submissions; one that is wrong does not stop the others.

    One without a result is played and its result written; the result of any other is played again and
    compared. What was stopped goes on where it was.

    Args:
        board: the leaderboard's folder.
        names: ``track/name`` each; none: all.
        sample: play only this share of the lines again, drawn at random, at least one of each submission.
        sample_seed: of the draw; None: a new one, which is said.
        update: play anew, and replace, results that do not fit what is submitted or were edited.
        since: a revision of git that is trusted. Entries whose submission or result is not as it was there
            are played whole, whatever the sample, and the lines of this playing become their result; what
            came along as a result is compared with them.
        changes_known: that other files changed since, too, is known.
        jobs: how many policies are played at once.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.jobs.run.run_jobs`.
        address: of a Ray cluster.
        say: told a line per submission as it ends.

    Returns:
        The verdicts, by track and name.

    Raises:
        UserError: no such board or submission, a share out of range, changes that are not known, or no
            cluster.
    """
    board = Path(board)
    new = frozenset() if since is None else _new(board, since, changes_known)
    with at_work(board):
        desk = _Desk(say, board, new)
        cases = desk.cases(submission_folders(board, names), update)
        cases = _drawn(cases, sample, sample_seed, say)
        if not names:
            desk.check_strays()
        _play([job for case in cases for job in desk.jobs(case)], jobs, backend, address, desk)
        for case in cases:
            desk.settle(case)
    return sorted(desk.verdicts.values(), key=lambda verdict: verdict.name)


def _new(board: Path, since: str, known: bool) -> frozenset[str]:
    """The entries that changed since a revision, if nothing else did that nobody knows of."""
    found = changes_since(board, since)
    if found.others and not known:
        few = ", ".join(found.others[:5]) + (", ..." if len(found.others) > 5 else "")
        raise UserError(
            f"since: {len(found.others)} files of no entry are not as they were: {few}; read them, then say "
            "--changes-known"
        )
    return found.entries


def _drawn(
    cases: list[Case], sample: float | None, sample_seed: int | None, say: Callable[[str], None]
) -> list[Case]:
    """The cases, or what is drawn of them.

    Raises:
        UserError: a share out of range.
    """
    if sample is None:
        return cases
    seed = random.SystemRandom().randrange(2**32) if sample_seed is None else sample_seed
    say(f"sample: {100 * sample:g} % of all lines, --sample-seed {seed}")
    return sampled(cases, sample, seed)


def _play(jobs: list[Job], workers: int, backend: str, address: str | None, desk: _Desk) -> None:
    """Run the jobs, in this process where nothing else is asked for; why some failed is left on the desk."""
    if (workers, backend, address) != (1, "loky", None):
        desk.failed |= run_jobs(jobs, workers, backend, address, say=lambda line: None)
        return
    for job in jobs:
        if not job.done():
            outcome = attempt(job.run, os.getcwd())
            if outcome.error is None:
                job.keep(outcome.result)
            else:
                desk.failed[job.name] = outcome.error


class _Desk:
    """Where lines come in; a submission is settled as soon as its last one is there."""

    def __init__(self, say: Callable[[str], None], board: Path, new: Collection[str]) -> None:
        self.verdicts: dict[str, Verdict] = {}
        self.failed: dict[str, str] = {}
        self._say, self._board, self._new = say, board, new

    def cases(self, folders: Sequence[Path], update: bool) -> list[Case]:
        """The cases of folders; a verdict on each that is wrong, or whose result is, or that has gone."""
        aside = {name: outcome_of(partial(set_aside, self._board, *name.split("/"))) for name in self._new}
        for name in sorted(self._new):
            if not (self._board / "submissions" / name).is_dir():
                self._give(name, False, "its submission was there, or its result came, and is gone")
        found = []
        for folder in folders:
            name = f"{folder.parent.name}/{folder.name}"
            read = outcome_of(partial(make_case, self._board, folder, update, self._new))
            error = read.error if name not in aside else read.error or aside[name].error
            if error is not None:
                self._give(name, False, error)
            else:
                found.append(
                    replace(read.result, claimed=aside[name].result) if name in aside else read.result
                )
        return found

    def check_strays(self) -> None:
        """Give a verdict on results whose submission is not there."""
        for track in TRACKS:
            for path in sorted((self._board / "results" / track).glob("*.jsonl")):
                if not (self._board / "submissions" / track / path.stem).is_dir():
                    self._give(f"{track}/{path.stem}", False, f"result {path}: no such submission")

    def jobs(self, case: Case) -> list[Job]:
        """A job per part of a case."""
        found = []
        for part, meetings in case.wanted:
            job = folder_job(
                _job_name(case, part),
                case.work / part.name,
                partial(fill, part, meetings),
                partial(_is_done, case.work / part.name, meetings),
            )
            found.append(replace(job, keep=partial(self._keep, job, case)))
        return found

    def settle(self, case: Case) -> None:
        """Give the verdict on a case, unless it is given already."""
        if case.name in self.verdicts:
            return
        errors = [self.failed[n] for part, _ in case.wanted if (n := _job_name(case, part)) in self.failed]
        if errors:
            self._give(case.name, False, errors[0])
            return
        judged, walls = outcome_of(partial(_judge, case)), outcome_of(partial(_open, case))
        shutil.rmtree(case.work, ignore_errors=True)
        if case.claimed is not None:
            forget(case.claimed)
        good, line = judged.result if judged.error is None else (False, judged.error)
        self._give(case.name, good, line + (walls.result or "") + (_copied(case) if good else ""))

    def _keep(self, job: Job, case: Case, result: Any) -> None:
        job.keep(result)
        if all(_is_done(case.work / part.name, meetings) for part, meetings in case.wanted):
            self.settle(case)

    def _give(self, name: str, good: bool, line: str) -> None:
        self.verdicts[name] = Verdict(name, good, printable(line))
        self._say(printable(f"{name}: {line}"))


def _job_name(case: Case, part: Part) -> str:
    return f"{case.name} {part.name}"


def _is_done(folder: Path, meetings: Sequence[Meeting]) -> bool:
    there = lines_in(folder)
    return failure_in(folder) is not None or all(key_of(*meeting) in there for meeting in meetings)


def _judge(case: Case) -> tuple[bool, str]:
    """Whether all is well, and what is to be said; writes the result where there is none."""
    folders = [(case.work / part.name, meetings) for part, meetings in case.wanted]
    why = next((said for folder, _ in folders if (said := failure_in(folder))), None)
    lines: list[Line] = []
    for folder, meetings in folders if why is None else ():
        there = lines_in(folder)
        lines += [there[key_of(*meeting)] for meeting in meetings]
    if case.whole and lines and all(line.lost == len(line.returns) for line in lines):
        why = "all of its rounds are lost by rule: its answers are no valid actions"
    if case.known is None:
        return _first(case, lines, why)
    if not case.known.verified:
        return _still_failed(case, why)
    if why is not None:
        return False, f"the result is verified, but now: {why}"
    found = disagreements(lines, case.known.lines, case.fields)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return False, f"the result does not hold: {found[0]}{more}"
    same = same_to_the_bit(lines, case.known.lines)
    return True, f"holds: {same} of {len(lines)} lines played again are the same to the bit"


def _open(case: Case) -> str:
    """What the processes of a case's policies could not be kept from, in words; nothing where all is well."""
    found = dict.fromkeys(name for part, _ in case.wanted for name in open_in(case.work / part.name))
    return f"; this machine cannot keep a policy from {', '.join(found)}" if found else ""


def _copied(case: Case) -> str:
    """Who of a new entry plays like whom, in words; of one that has a result it was said before."""
    if case.known is not None:
        return ""
    told = outcome_of(partial(told_apart, case.submission, case.submission.folder.parents[2]))
    lines = [told.error] if told.error is not None else told.result
    return "".join(f"; {line}" for line in lines)


def _first(case: Case, lines: list[Line], why: str | None) -> tuple[bool, str]:
    whose = (case.submission.slug, case.submission.track, case.printed)
    if why is not None:
        write_result(case.path, failed_result(*whose, why))
        return False, f"not verified: {why}"
    result = verified_result(*whose, lines, case.fields)
    write_result(case.path, result)
    wrong = None if case.claimed is None else _wrong(case, case.claimed, lines)
    if wrong is not None:
        return False, f"replaced: the result that came along {wrong}; commit this one: {told(result)}"
    return True, told(result)


def _wrong(case: Case, claimed: Path, lines: list[Line]) -> str | None:
    """What is wrong with a result that came along, None where it holds or there was none."""
    read = outcome_of(partial(result_at, claimed, case.submission, case.fields))
    if read.error is not None:
        return "is none of this entry's, or was edited"
    claim: Result | None = read.result
    if claim is None:
        return None
    if not claim.verified:
        return "says that it is not verified"
    found = disagreements(lines, claim.lines, case.fields)
    return f"does not hold: {found[0]}" if found else None


def _still_failed(case: Case, why: str | None) -> tuple[bool, str]:
    if not case.wanted:
        return True, "not verified; not part of a sample"
    if why is None:
        return False, f"the result is not verified, but it plays; {again(case.submission)}"
    return True, f"not verified, as before: {why}"


def told(result: Result) -> str:
    """What a result says, in a line."""
    if not result.verified:
        return f"not verified: {result.head['reason']}"
    summary = result.head["summary"]
    role = ranked_by(summary["scores"])
    score = summary["scores"][role]
    lost = f", {summary['lost']:,} of {summary['rounds']:,} rounds lost by rule" if summary["lost"] else ""
    return f"verified: {role} {score['value']:.1f} [{score['low']:.1f}, {score['high']:.1f}]{lost}"


def run_one(folder: str | Path, update: bool = False, **how: Any) -> Verdict:
    """Verify the submission of a folder ``<board>/submissions/<track>/<name>``; see :func:`verify`.

    Raises:
        UserError: a folder that lies elsewhere, or no cluster.
    """
    given, folder = folder, Path(folder).resolve()
    track = folder.parent.name
    if folder.parent.parent.name != "submissions" or track not in TRACKS:
        hint = meant(track, TRACKS) if folder.parent.parent.name == "submissions" else ""
        expected = f"<leaderboard>/submissions/<{'|'.join(TRACKS)}>/<name>"
        raise UserError(f"{given}: expected a folder {expected}{hint}")
    board = Path(brief(folder.parents[2]))
    (verdict,) = verify(board, [f"{folder.parent.name}/{folder.name}"], update=update, **how)
    return verdict
