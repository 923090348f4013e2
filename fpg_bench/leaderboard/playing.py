"""Playing a submission: every policy in a process of its own, a line per rival."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.compare import transcript_file
from fpg_bench.evaluation.entry import Entry, Same
from fpg_bench.evaluation.match import replaying
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import Record, read_record
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite
from fpg_bench.leaderboard.sandbox import PolicyFailed, missing_here
from fpg_bench.leaderboard.submission import Policy, Submission
from fpg_bench.leaderboard.transcripts import FOLDER, local, told

RECORDS = "records.jsonl"
FAILED = "failed"  # the key of a row that says why a part could not be played on
OPEN = "open"  # the key of a row that says what the policy could not be kept from
Matchup = tuple[Suite, Rival]
Key = tuple[str, str, str]  # of a meeting: the suite's name, its hash's first digits, the rival's name


@dataclass(frozen=True)
class Part:
    """What is played of a submission: a script, the policy of one training seed (perhaps of the zoo), or a
    planner whose transcripts were ``recorded`` in the submission's folder.
    """

    slug: str
    seed: int | None
    plays: str | Policy
    shipped: bool = False
    recorded: Path | None = None

    @property
    def name(self) -> str:
        """What folders and lines about it call it."""
        return "script" if self.seed is None else f"seed_{self.seed}"

    @property
    def fingerprint(self) -> str:
        """The hash of its policy, or its script's name."""
        return self.plays if isinstance(self.plays, str) else self.plays.sha256

    def entry(self, player: Any, suite: Suite) -> Entry:
        """The part as an entry that meets rivals of a suite, played by a player."""
        if self.recorded is not None:
            return Entry(self.slug, None, self.fingerprint, partial(_recorded, self.recorded, suite))
        return Entry(self.slug, self.seed, self.fingerprint, Same(player))


def _recorded(folder: Path, suite: Suite, ally: Rival) -> Any:
    """The planner of a submission's transcripts against an ally; no language model is asked.

    Raises:
        UserError: a transcript is not that of these matches: its prompts are others, or something of it is
            missing or was changed.
    """
    about, prompt = told(folder, suite)
    return replaying(suite.scenario, prompt, about, transcript_file(folder / FOLDER, ally.name))


def parts_of(submission: Submission) -> list[Part]:
    """All that is played of a submission, by training seed."""
    slug = submission.slug
    if submission.script is not None:
        return [Part(slug, None, submission.script)]
    if submission.track == PLANNER:
        return [Part(slug, None, "transcripts", recorded=submission.folder)]
    policies = sorted(submission.policies, key=lambda policy: policy.seed)
    return [Part(slug, policy.seed, policy, submission.zoo is not None) for policy in policies]


def key_of(suite: Suite, rival: Rival) -> Key:
    """What tells a meeting from all others."""
    return suite.name, suite.hash[:16], rival.name


def matchups_of(suites: Iterable[Suite]) -> list[Matchup]:
    """All meetings of several suites."""
    return [(suite, rival) for suite in suites for rival in suite.rivals]


def part_records(part: Part, matchups: Iterable[Matchup]) -> Iterator[Record]:
    """Play a part against some rivals, here and now.

    Raises:
        PolicyFailed: a policy died, or took longer than it may.
        UserError: a transcript is not that of these matches.
    """
    with make_match(part.plays) as player:
        for suite, rival in matchups:
            try:
                record = play(part.entry(player, suite), suite, rival)
            except UserError as error:
                if part.recorded is None:
                    raise
                raise UserError(f"against {rival.name}: {local(error, part.recorded)}") from error
            # How long planning took is left out, since that is never twice the same.
            plans = record.plans and dataclasses.replace(record.plans, seconds=0.0)
            yield dataclasses.replace(record, plans=plans)


@contextlib.contextmanager
def make_match(plays: str | Policy) -> Iterator[Any]:
    """A player: a script's name as it is, a policy in a process of its own for as long as it plays."""
    if isinstance(plays, str):
        yield plays
        return
    from fpg_bench.leaderboard.policy_client import PolicyClient

    with PolicyClient(plays) as host:
        yield host


def fill(part: Part, matchups: Sequence[Matchup], folder: Path) -> None:
    """Play a part's meetings into a folder, a line each as it ends; what is there is not played again.

    A policy that cannot be played on leaves a row that says why.
    """
    file, there = RowFile(folder / RECORDS), records_in(folder)
    missing = [matchup for matchup in matchups if key_of(*matchup) not in there]
    try:
        for record in part_records(part, missing):
            file.append([record.row()])
    except PolicyFailed as error:
        file.append([{FAILED: f"{part.name}: {error}"}])
    if isinstance(part.plays, Policy) and (lacking := missing_here()):
        file.append([{OPEN: lacking}])


def records_in(folder: Path) -> dict[Key, Record]:
    """The lines of a part's folder, by their meetings."""
    rows = [row for row in RowFile(folder / RECORDS).read() if not {FAILED, OPEN} & row.keys()]
    records = (read_record(row, f"lines {folder / RECORDS}") for row in rows)
    return {(record.suite, record.suite_hash, record.rival): record for record in records}


def failure_in(folder: Path) -> str | None:
    """Why the part of a folder could not be played on; None where it could."""
    rows = RowFile(folder / RECORDS).read()
    return next((str(row[FAILED]) for row in rows if FAILED in row), None)


def open_in(folder: Path) -> list[str]:
    """What the policy of a part's folder could not be kept from."""
    rows = RowFile(folder / RECORDS).read()
    return next((list(row[OPEN]) for row in rows if OPEN in row), [])
