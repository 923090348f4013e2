"""Describe a season in words, and check that its seed follows from the entries it was closed over."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.products.leaderboard.season.entries import SeasonEntry, read_entries, season_seed
from fpg_bench.products.leaderboard.season.season import Season, load_season
from fpg_bench.products.leaderboard.season_keys import season_label

_TITLES = {"opponent": "Opponents, rivals of allies", "ally": "Allies, rivals of opponents"}


def check_entries(season: Season, entries: list[SeasonEntry]) -> None:
    """Raise UserError where an entry is missing or has changed, or the seed does not follow from them."""
    by_name = {entry.name: entry for entry in entries}
    for name, hashes in season.entries.items():
        present = by_name.get(name)
        if present is None or list(present.hashes) != hashes:
            what = "is missing" if present is None else "has changed"
            raise UserError(
                f"season {season.name}: the entry {name}, which it was closed over, {what}; look "
                "at it at the commit that added it"
            )
    label = season.name if season.number is None else season_label(season.number, season.scenario)
    if season_seed(season.protocol, label, [by_name[name] for name in season.entries]) != season.seed:
        raise UserError(f"season {season.name}: its seed does not follow from its entries")
    if season.protocol != PROTOCOL:
        raise UserError(
            f"season {season.name}: is of protocol {season.protocol}, this version has {PROTOCOL}"
        )


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
        header = f"  {'name':5} {'reward':8} {'algorithm':19} {'steps':>9}  {'entries earn':>12}"
        yield f"{header}  trained against"
        for member in season.members[side]:
            flight = ", flies" if member.path == "learned" and side == "opponent" else ""
            yield (
                f"  {member.name:5} {member.reward:8} {member.algorithm:19} {member.steps:9,}  "
                f"{member.entries_earn:12.2f}  {len(member.targets)} players{flight}"
            )
    yield ""
    for check in season.checks:
        yield f"{'holds' if check.holds else 'FAILS'}: {check.name}: {check.line}"
    yield "season.yml in its folder names the players."
    try:
        entries = read_entries(board, inspect_onnx=False, scenario=season.scenario)
    except UserError:
        yield f"No board at {board}: its late entries are unknown."
        return
    try:
        check_entries(season, entries)
        yield "Its seed follows from the entries of this board that it was closed over."
    except UserError as error:
        yield f"Not checked: {error}"
    if late := late_entries(season, entries):
        yield f"Late entries, submitted or changed after it was closed: {', '.join(late)}"
    else:
        yield "No entry of the board came after it was closed."
