"""A season in words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.seasons.audit import later_entries
from fpg_bench.seasons.entries import read_entries
from fpg_bench.seasons.season import Season, load_season

SIDES = {"opponent": "Opponents, met by allies", "ally": "Allies, met by opponents"}


def told(name: str | Path, board: str | Path) -> Iterator[str]:
    """The lines of a season, and which entries of a board came later.

    Raises:
        UserError: no such season, or files that do not fit it.
    """
    season = load_season(name)
    kind = "training population" if season.number is None else f"season {season.number}"
    yield f"{season.name}: {kind} of protocol {season.protocol}, hash {season.hash}"
    yield f"seed {season.seed}, from the policies of {len(season.entries)} entries"
    for side, title in SIDES.items():
        yield ""
        yield f"{title}: {len(season.members[side])}, chosen from {season.candidates[side]} candidates"
        yield from _members(season, side)
    yield ""
    yield _later(season, board)


def _members(season: Season, side: str) -> Iterator[str]:
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
