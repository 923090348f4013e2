"""The verdict: submissions are played, or played again, and compared with the results that are kept."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, meant, printable
from fpg_bench.common.parallel import Job, Workers, folder_job, outcome_of, run_jobs
from fpg_bench.leaderboard.cases import (
    Case,
    at_work,
    check_share,
    forget,
    make_case,
    sampled,
    set_aside,
    submission_folders,
)
from fpg_bench.leaderboard.changed_entries import changed_entries
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.playing import Matchup, Part, failure_in, fill, key_of, records_in
from fpg_bench.leaderboard.submission import TRACKS
from fpg_bench.leaderboard.verdicts import Verdict, judge, open_walls


def verify(
    board: str | Path,
    names: Sequence[str] = (),
    *,
    sample: float | None = None,
    sample_seed: int | None = None,
    update: bool = False,
    since: str | None = None,
    changes_known: bool = False,
    say: Callable[[str], None] = print,
    **workers: Any,
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
        say: told a line per submission as it ends.
        **workers: how many policies are played at once, and where; see :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The verdicts, by track and name.

    Raises:
        UserError: no such board or submission, a share out of range, changes that are not known, or no
            cluster.
    """
    if sample is not None:
        check_share(sample)
    board = Path(board)
    new = frozenset() if since is None else _new(board, since, changes_known)
    with at_work(board):
        session = _Verification(say, board, new)
        cases = session.cases(submission_folders(board, names), update)
        cases = _drawn(cases, sample, sample_seed, say)
        if not names:
            session.check_strays()
        jobs = [job for case in cases for job in session.jobs(case)]
        crew = Workers(**workers)
        session.failed |= run_jobs(jobs, crew.jobs, crew.backend, crew.address, say=None)
        for case in cases:
            session.settle(case)
    return sorted(session.verdicts.values(), key=lambda verdict: verdict.name)


def _new(board: Path, since: str, known: bool) -> frozenset[str]:
    """The entries that changed since a revision, if nothing else did that nobody knows of."""
    found = changed_entries(board, since)
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
    """The cases, or what is drawn of them."""
    if sample is None:
        return cases
    seed = random.SystemRandom().randrange(2**32) if sample_seed is None else sample_seed
    say(f"sample: {100 * sample:g} % of all lines, --sample-seed {seed}")
    return sampled(cases, sample, seed)


class _Verification:
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
        for part, matchups in case.wanted:
            job = folder_job(
                _job_name(case, part),
                case.work / part.name,
                partial(fill, part, matchups),
                partial(_is_done, case.work / part.name, matchups),
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
        judged, walls = outcome_of(partial(judge, case)), outcome_of(partial(open_walls, case))
        shutil.rmtree(case.work, ignore_errors=True)
        if case.claimed is not None:
            forget(case.claimed)
        good, record = judged.result if judged.error is None else (False, judged.error)
        self._give(case.name, good, record + (walls.result or ""))

    def _keep(self, job: Job, case: Case, result: Any) -> None:
        job.keep(result)
        if all(_is_done(case.work / part.name, matchups) for part, matchups in case.wanted):
            self.settle(case)

    def _give(self, name: str, good: bool, record: str) -> None:
        self.verdicts[name] = Verdict(name, good, printable(record))
        self._say(printable(f"{name}: {record}"))


def _job_name(case: Case, part: Part) -> str:
    return f"{case.name} {part.name}"


def _is_done(folder: Path, matchups: Sequence[Matchup]) -> bool:
    there = records_in(folder)
    return failure_in(folder) is not None or all(key_of(*matchup) in there for matchup in matchups)


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
