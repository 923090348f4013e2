"""Describe a season in words, and audit it: train members again and compare what the entries earn."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import other_side
from fpg_bench.common.parallel import Job, Workers, check_all_done, folder_job, run_jobs
from fpg_bench.evaluation.seeds import PROTOCOL, season_label
from fpg_bench.evaluation.store import Store
from fpg_bench.players.agent import read_card
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.season.candidates import (
    PROFILE,
    against_candidate,
    earned,
    play_candidate,
    scale_of,
    train_candidate,
)
from fpg_bench.products.leaderboard.season.entries import SeasonEntry, read_entries, season_seed
from fpg_bench.products.leaderboard.season.recipes import Recipe, shuffled
from fpg_bench.products.leaderboard.season.season import Season, SeasonMember, load_season
from fpg_bench.products.leaderboard.verdicts import WITHIN, Verdict
from fpg_bench.training.run_folder import RunFolder

_TITLES = {"opponent": "Opponents, rivals of allies", "ally": "Allies, rivals of opponents"}


def audit_season(
    season: Season,
    entries: list[SeasonEntry],
    work: Path,
    members: list[str] | None = None,
    count: int = 2,
    *,
    workers: Workers | int = 2,
) -> list[Verdict]:
    """Train some members of a season again, and play the entries against the published and the new ones.

    The published policies stay authoritative: torch is not bit-identical on every machine. A verdict is bad
    if the entries do not earn against a published policy what ``season.yml`` says.

    Args:
        season: a closed season.
        entries: the board's present entries, from which the seed is checked.
        work: folder to train in.
        members: their names; None: ``count`` per side, drawn by the folder's name.
        count: number per side.
        workers: number of members trained at once, or :class:`fpg_bench.common.parallel.Workers`.

    Raises:
        UserError: an entry that the season was closed over is missing or has changed, a seed that does not
            follow from them, or an unknown member.
    """
    check_entries(season, entries)
    chosen = _choose_members(season, members, count, work)
    check_all_done(run_jobs([_training_job(work, member, season.scenario) for _, member in chosen], workers))
    return [_compare(season, entries, work, side, member) for side, member in chosen]


def check_entries(season: Season, entries: list[SeasonEntry]) -> None:
    """Raise UserError where an entry is missing or has changed, or the seed does not follow from them."""
    by_name = {entry.name: entry for entry in entries}
    for name, hashes in season.entries.items():
        present = by_name.get(name)
        if present is None or list(present.hashes) != hashes:
            what = "is missing" if present is None else "has changed"
            raise UserError(
                f"season {season.name}: the entry {name}, which it was closed over, {what}; audit the season "
                "at the commit that added it"
            )
    label = season.name if season.number is None else season_label(season.number, season.scenario)
    if season_seed(season.protocol, label, [by_name[name] for name in season.entries]) != season.seed:
        raise UserError(f"season {season.name}: its seed does not follow from its entries")
    if season.protocol != PROTOCOL:
        raise UserError(
            f"season {season.name}: is of protocol {season.protocol}, this version has {PROTOCOL}"
        )


def _choose_members(
    season: Season, names: list[str] | None, count: int, work: Path
) -> list[tuple[str, SeasonMember]]:
    all_members = list(season.all_members())
    if names is None:
        drawn = shuffled(all_members, season.seed, work.name)
        return [pair for side in SIDES for pair in [p for p in drawn if p[0] == side][:count]]
    by_name = {member.name: (side, member) for side, member in all_members}
    if unknown := [name for name in names if name not in by_name]:
        raise UserError(f"season {season.name}: has no member {unknown[0]!r}{nearest(unknown[0], by_name)}")
    return [by_name[name] for name in names]


def _training_job(work: Path, recipe: Recipe, scenario: str) -> Job:
    folder = work / recipe.side / recipe.name
    return folder_job(
        f"{recipe.side}/{recipe.name}",
        folder,
        partial(train_candidate, recipe, scenario=scenario),
        RunFolder(folder).is_finished,
    )


def _compare(
    season: Season, entries: list[SeasonEntry], work: Path, side: str, member: SeasonMember
) -> Verdict:
    other = other_side(side)
    published, again = season.agent(side, member), work / side / member.name / "agent"
    wanted = [
        against_candidate(
            *(player, other, str(agent), member.path if side == "opponent" else entry.path),
            *(season.seed, season.scenario),
            name=entry.name,
            number=number,
        )
        for entry in entries
        if entry.side == other and entry.name in season.entries
        for number, player in enumerate(entry.players)
        for agent in (published, again)
    ]
    records = Store(work / side / member.name / PROFILE).fill(wanted, play_candidate)
    returns = np.array([earned(record, other, season.scenario)[other] for record in records]).reshape(-1, 2)
    by_entry: dict[str, list[float]] = {}
    for record, value in zip(records[::2], returns[:, 0], strict=True):
        by_entry.setdefault(record.entry, []).append(value)
    earn, scale = statistics.fmean(map(statistics.fmean, by_entry.values())), scale_of(other, season.scenario)
    name, stored = f"{side}/{member.name}", member.entries_earn
    if abs(earn - stored) > WITHIN * (scale.top - scale.zero):
        line = f"the result does not hold: entries_earn {earn:.3f}, season.yml says {stored:.3f}"
        return Verdict(name, False, line)
    is_same = read_card(again).policy_sha256 == member.policy_sha256
    line = (
        f"{'the same policy' if is_same else 'another policy'}; entries earn "
        f"{np.abs(returns[:, 0] - returns[:, 1]).mean():.2f} per step more or less, correlation "
        f"{np.corrcoef(returns.T)[0, 1]:.3f}"
    )
    return Verdict(name, True, line)


def late_entries(season: Season, entries: list[SeasonEntry]) -> list[str]:
    """Return the names of entries that came or changed after a season was closed."""
    return [
        entry.name
        for entry in entries
        if entry.scenario == season.scenario and season.entries.get(entry.name) != list(entry.hashes)
    ]


def describe_season(name: str | Path, board: str | Path) -> Iterator[str]:
    """Yield the lines that describe a season and the late entries of a board.

    Raises:
        UserError: no such season, or files that do not fit it.
    """
    season = load_season(name)
    kind = "training population" if season.number is None else f"season {season.number}"
    yield f"{season.name}: {kind} of protocol {season.protocol}, hash {season.hash}"
    yield f"seed {season.seed}, from the policies of {len(season.entries)} entries"
    for side, title in _TITLES.items():
        yield ""
        yield f"{title}: {len(season.members[side])}, selected from {season.candidates[side]} candidates"
        header = f"  {'name':5} {'reward':9} {'algorithm':11} {'steps':>9}  {'entries earn':>12}  "
        yield f"{header}trained against"
        for member in season.members[side]:
            flight = " (flies itself)" if member.path == "learned" and side == "opponent" else ""
            yield (
                f"  {member.name:5} {member.reward:9} {member.algorithm:11} {member.steps:9,}  "
                f"{member.entries_earn:12.2f}  {', '.join(member.targets)}{flight}"
            )
    yield ""
    try:
        late = late_entries(season, read_entries(board, inspect_onnx=False, scenario=season.scenario))
    except UserError:
        yield f"No board at {board}: its late entries are unknown."
        return
    if late:
        yield f"Late entries, submitted or changed after it was closed: {', '.join(late)}"
    else:
        yield "No entry of the board came after it was closed."
