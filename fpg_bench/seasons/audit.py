"""Looking at a season: in words, and by training members again and comparing what the entries earn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.files import read_json
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.seasons.candidates import train_candidate
from fpg_bench.seasons.close import OTHER, ROUNDS, played
from fpg_bench.seasons.entries import SeasonEntry, read_entries, season_seed
from fpg_bench.seasons.recipe import Recipe, shuffled
from fpg_bench.seasons.season import Season, SeasonMember, load_season
from fpg_bench.training.run_folder import RunFolder

_TITLES = {"opponent": "Opponents, met by allies", "ally": "Allies, met by opponents"}


@dataclass(frozen=True)
class Audited:
    """What came of training a member again.

    Attributes:
        same: whether the policies are the same to the bit.
        difference: the mean absolute difference of what players of the other side earn a step.
        correlation: of their returns against the two.
    """

    side: str
    name: str
    same: bool
    difference: float
    correlation: float


def audit(
    season: Season,
    entries: list[SeasonEntry],
    work: Path,
    members: list[str] | None = None,
    count: int = 2,
    *,
    rounds: int = ROUNDS,
    workers: int = 2,
    say: Callable[[str], None] = print,
) -> list[Audited]:
    """Train some members of a season again.

    The published policies are what counts: torch is not the same to the bit on every machine.

    Args:
        season: that was closed.
        entries: the board's now; the seed is checked with those of them that the season names.
        work: where members are trained.
        members: their names; None: ``count`` of each side, drawn by the folder's name.
        count: how many of each side.
        rounds: that each player plays against each of the two.
        workers: how many are trained at once.
        say: told a line per member that begins or ends.

    Raises:
        UserError: an entry that the season was closed over is missing or has changed, a seed that is not
            theirs, or no such member.
    """
    check_entries(season, entries)
    chosen = _members(season, members, count, work)
    for _, member in chosen:
        (work / member.recipe.side).mkdir(parents=True, exist_ok=True)
    check_all_done(run_jobs([_job(work, member.recipe) for _, member in chosen], workers, say=say))
    return [_compared(season, entries, work, side, member, rounds) for side, member in chosen]


def check_entries(season: Season, entries: list[SeasonEntry]) -> None:
    """Raise UserError where a season's seed does not follow from the board's entries."""
    now = {entry.name: entry for entry in entries}
    for name, hashes in season.entries.items():
        if name not in now:
            raise UserError(f"season {season.name}: was closed over the entry {name}, which is missing")
        if list(now[name].hashes) != hashes:
            raise UserError(f"season {season.name}: the entry {name} has changed since it was closed")
    number = season.name if season.number is None else season.number
    if season_seed(season.protocol, number, [now[name] for name in season.entries]) != season.seed:
        raise UserError(f"season {season.name}: its seed does not follow from its entries")
    if season.protocol != PROTOCOL:
        raise UserError(
            f"season {season.name}: is of protocol {season.protocol}, this version has {PROTOCOL}"
        )


def _members(
    season: Season, names: list[str] | None, count: int, work: Path
) -> list[tuple[str, SeasonMember]]:
    every = list(season.everyone())
    if names is None:
        drawn = shuffled(every, season.seed, work.name)
        return [pair for side in OTHER for pair in [p for p in drawn if p[0] == side][:count]]
    by_name = {member.name: (side, member) for side, member in every}
    if unknown := [name for name in names if name not in by_name]:
        raise UserError(f"season {season.name}: has no member {unknown[0]!r}{nearest(unknown[0], by_name)}")
    return [by_name[name] for name in names]


def _job(work: Path, recipe: Recipe) -> Job:
    folder = work / recipe.side / recipe.name
    train, done = partial(train_candidate, recipe), RunFolder(folder).is_finished
    return folder_job(f"{recipe.side}/{recipe.name}", folder, train, done)


def _compared(
    season: Season, entries: list[SeasonEntry], work: Path, side: str, member: SeasonMember, rounds: int
) -> Audited:
    other = OTHER[side]
    again = work / side / member.name / "agent"
    meet = [
        (e, player) for e in entries if e.side == other and e.name in season.entries for player in e.players
    ]
    returns = np.array(
        [
            [
                played(
                    player,
                    other,
                    str(agent),
                    member.recipe.path if side == "opponent" else entry.path,
                    season.seed,
                    rounds,
                )[other]
                for agent in (season.agent(side, member), again)
            ]
            for entry, player in meet
        ]
    )
    same = read_json(again / "agent.json", "agent")["policy_sha256"] == member.policy_sha256
    difference = float(np.abs(returns[:, 0] - returns[:, 1]).mean())
    return Audited(side, member.name, same, difference, float(np.corrcoef(returns.T)[0, 1]))


def later_entries(season: Season, entries: list[SeasonEntry]) -> list[str]:
    """The names of entries that came or changed after a season was closed: they had access to it."""
    return [e.name for e in entries if season.entries.get(e.name) != list(e.hashes)]


def told(name: str | Path, board: str | Path) -> Iterator[str]:
    """The lines of a season, and which entries of a board came later.

    Raises:
        UserError: no such season, or files that do not fit it.
    """
    season = load_season(name)
    kind = "training population" if season.number is None else f"season {season.number}"
    yield f"{season.name}: {kind} of protocol {season.protocol}, hash {season.hash}"
    yield f"seed {season.seed}, from the policies of {len(season.entries)} entries"
    for side, title in _TITLES.items():
        yield ""
        yield f"{title}: {len(season.members[side])}, chosen from {season.candidates[side]} candidates"
        yield from _told_members(season, side)
    yield ""
    yield _later(season, board)


def _told_members(season: Season, side: str) -> Iterator[str]:
    yield f"  {'name':5} {'paid for':9} {'by':11} {'steps':>9}  {'entries earn':>12}  trained against"
    for member in season.members[side]:
        recipe = member.recipe
        flown = " (flies itself)" if recipe.path == "learned" and side == "opponent" else ""
        yield (
            f"  {recipe.name:5} {recipe.reward:9} {recipe.algorithm:11} {recipe.steps:9,}  "
            f"{member.entries_earn:12.2f}  {', '.join(recipe.targets)}{flown}"
        )


def _later(season: Season, board: str | Path) -> str:
    try:
        later = later_entries(season, read_entries(board, contract=False))
    except UserError:
        return f"No board at {board}: nothing can be said of later entries."
    if not later:
        return "No entry of the board came after it was closed."
    return f"Entered or changed after it was closed, with access to it: {', '.join(later)}"
