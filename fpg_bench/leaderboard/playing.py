"""Playing a submission on its panel: every policy in a process of its own, a line per panel entry."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.evaluation.panel import Entry, Panel
from fpg_bench.evaluation.planner_references import PlannerTable
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.summary import check_references
from fpg_bench.evaluation.zoo_scores import sum_up
from fpg_bench.leaderboard.planner_track import TRACK, planner_line
from fpg_bench.leaderboard.sandbox import missing_here
from fpg_bench.leaderboard.submission import Policy, Submission
from fpg_bench.leaderboard.transcripts import FOLDER
from fpg_bench.rows import Row, RowFile

LINES = "lines.jsonl"
FAILED = "failed"  # the key of a row that says why a part could not be played on
OPEN = "open"  # the key of a row that says what the policy could not be kept from


@dataclass(frozen=True)
class Part:
    """What is played of a submission: a script, the policy of one training seed (perhaps of the zoo), or a
    planner whose transcripts were ``recorded`` in the submission's folder.
    """

    seed: int | None
    plays: str | Policy
    shipped: bool = False
    recorded: Path | None = None

    @property
    def name(self) -> str:
        """What folders and lines about it call it."""
        return "script" if self.seed is None else f"seed_{self.seed}"


def parts_of(submission: Submission) -> list[Part]:
    """All that is played of a submission, by training seed."""
    if submission.script is not None:
        return [Part(None, submission.script)]
    if submission.track == TRACK:
        return [Part(None, FOLDER, recorded=submission.folder)]
    policies = sorted(submission.policies, key=lambda policy: policy.seed)
    return [Part(policy.seed, policy, submission.zoo is not None) for policy in policies]


def run_submission(submission: Submission, panel: Panel) -> list[Row]:
    """Play all of a submission on all entries of a panel, here and now.

    Returns:
        A line per training seed and entry: what :func:`fpg_bench.evaluation.zoo_scores.score_lines` says, how
        many rounds were ``lost``, and the steps per frequency point of both sides.

    Raises:
        PolicyFailed: a policy died, or took longer than it may.
        UserError: the panel's scores can't be normalised.
    """
    return [line for part in parts_of(submission) for line in part_lines(part, panel, panel.entries)]


def part_lines(part: Part, panel: Panel, entries: Iterable[Entry]) -> Iterator[Row]:
    """The lines of a part on some entries of a panel; raises as :func:`run_submission` does."""
    if isinstance(panel, PlannerTable):
        planner = part.recorded or str(part.plays)
        yield from (planner_line(planner, panel, entry) for entry in entries)
        return
    check_references(panel)
    with seated(part.plays) as player:
        for entry in entries:
            yield _line(player, part, panel, entry)


@contextlib.contextmanager
def seated(plays: str | Policy) -> Iterator[Any]:
    """A player: a script's name as it is, a policy in a process of its own for as long as it plays."""
    if isinstance(plays, str):
        yield plays
        return
    from fpg_bench.leaderboard.host import PolicyHost

    with PolicyHost(plays) as host:
        yield host


def fill(part: Part, panel: Panel, entries: Sequence[str], folder: Path) -> None:
    """Play a part on these entries into a folder, a line each as it ends; what is there is not played again.

    A policy that cannot be played on leaves a row that says why.
    """
    from fpg_bench.leaderboard.host import PolicyFailed

    file = RowFile(folder / LINES)
    there = lines_in(folder)
    missing = [entry for entry in panel.entries if entry.name in entries and entry.name not in there]
    try:
        for line in part_lines(part, panel, missing):
            file.append([line])
    except PolicyFailed as error:
        file.append([{"entry": FAILED, "reason": f"{part.name}: {error}"}])
    if isinstance(part.plays, Policy) and missing_here():
        file.append([{"entry": OPEN, "to": missing_here()}])


def lines_in(folder: Path) -> dict[str, Row]:
    """The rows of a part's folder by entry."""
    return {row["entry"]: row for row in RowFile(folder / LINES).read()}


def lost_rounds(player: Any, count: int) -> np.ndarray:
    """``(count,)`` bool: which games' present rounds a player has lost by an answer that is none."""
    found = getattr(player, "invalid", None)
    return np.zeros(count, bool) if found is None else np.array(found, bool)


def _line(player: Any, part: Part, panel: Panel, entry: Entry) -> Row:
    rows: list[Row] = []
    lost: list[bool] = []
    for played in play_entry(player, panel, entry, panel.rounds):
        rows += played
        lost += lost_rounds(player, len(played)).tolist()
    _give_lowest([row for row, gone in zip(rows, lost, strict=True) if gone], rows, panel, entry)
    points = {
        key: np.sum([row[key] for row in rows], axis=0).tolist() for key in ("ally_points", "jam_points")
    }
    head = {"training_seed": part.seed, "entry": entry.name}
    return head | sum_up(rows, panel) | {"lost": sum(lost)} | points


def _give_lowest(lost: list[Row], rows: list[Row], panel: Panel, entry: Entry) -> None:
    """Give lost rounds the lowest return that the random player, or this one in a round of its own, had."""
    if not lost:
        return
    assert panel.references is not None
    key = f"{panel.side}_return"
    own = [row[key] for row in rows if not any(row is gone for gone in lost)]
    lowest = min([*panel.references[entry.name].random, *own])
    for row in lost:
        row[key] = lowest
