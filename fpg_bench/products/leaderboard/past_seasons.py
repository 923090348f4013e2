"""Past seasons: a row for each entry, kept before the next season replaces the results."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le
from pydantic import Field

from fpg_bench.common.files import write_whole
from fpg_bench.common.rows import RowFile
from fpg_bench.common.schema import PositiveInt, Strict, parse
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.products.leaderboard.board import Board, CrossPlay, make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import seasons_file
from fpg_bench.products.leaderboard.tracks import TRACKS, UNSEEN

_DIGITS = 2


class SeasonRow(Strict):
    """An entry in a season.

    Attributes:
        season: the number of the season that ranked it.
        track: the key of its track, from which the season's scenario follows.
        slug, name: as the board had them.
        rank: best and worst; None for a reference.
        score: over the rivals of the season: value, and both ends of its 95 % interval (None: a single unit).
        by_group: its score over each kind of rivals.
        share: of its side's mixture in cross-play; None where cross-play does not show it.
    """

    season: PositiveInt
    track: str
    slug: str
    name: str
    rank: Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)] | None
    score: Annotated[tuple[float, float | None, float | None], Field(strict=False)]
    by_group: dict[str, float]
    share: Annotated[float, Ge(0), Le(1)] | None


def season_rows(board: Board, numbers: Mapping[str, int]) -> list[SeasonRow]:
    """Return the rows of a board's seasons, track by track, best first.

    Args:
        board: the board.
        numbers: of the closed season, by scenario; others have no rows.
    """
    return [
        SeasonRow(
            season=numbers[TRACKS[track.key].scenario],
            track=track.key,
            slug=entry.slug,
            name=entry.name,
            rank=figures.rank,
            score=_written(figures.scores[UNSEEN]),
            by_group={group: round(score.value, _DIGITS) for group, score in figures.by_group.items()},
            share=_share(board.crossplay.get(TRACKS[track.key].scenario), track.side, entry.slug),
        )
        for track in board.tracks
        if TRACKS[track.key].scenario in numbers
        for entry, figures in track.verified()
        if UNSEEN in figures.scores
    ]


def _written(score: Interval) -> tuple[float, float | None, float | None]:
    low, high = (None if math.isnan(end) else round(end, _DIGITS) for end in (score.low, score.high))
    return round(score.value, _DIGITS), low, high


def _share(crossplay: CrossPlay | None, side: str, slug: str) -> float | None:
    """Return the share of a player in the mixture of its side; None where cross-play does not show it."""
    if crossplay is None:
        return None
    nash, shown = crossplay.nash, {"ally": crossplay.allies, "opponent": crossplay.opponents}
    shares = nash.ally if side == "ally" else nash.opponent
    return shares.get(slug, 0.0) if slug in shown.get(side, ()) else None


def read_seasons(folder: str | Path = "leaderboard") -> list[SeasonRow]:
    """Return the rows that a leaderboard keeps of its seasons; none if it keeps none.

    Raises:
        UserError: the file cannot be read, or a line of it is no such row.
    """
    file = seasons_file(Path(folder))
    return [
        parse(SeasonRow, row, f"seasons {file}: line {number}")
        for number, row in enumerate(RowFile(file).read(), 1)
    ]


def keep_seasons(folder: str | Path = "leaderboard") -> list[SeasonRow]:
    """Write what is to be kept of the present season of each scenario, from the board's verified results.

    Rows of the same season and track that the file already has are replaced, all others stay.

    Returns:
        The new rows; of a season that no entry has played, there are none.

    Raises:
        UserError: a file cannot be read.
    """
    folder = Path(folder)
    entries = load_entries(folder)
    numbers = {scenario: key.number for scenario, key in entries.suites.seasons.items()}
    rows = season_rows(make_board(entries), numbers)
    made = {(row.season, row.track) for row in rows}
    others = [row for row in read_seasons(folder) if (row.season, row.track) not in made]
    _write(seasons_file(folder), [*others, *rows])
    return rows


def _write(file: Path, rows: Sequence[SeasonRow]) -> None:
    lines = [json.dumps(row.model_dump(), separators=(",", ":"), allow_nan=False) for row in rows]
    write_whole(file, "".join(f"{line}\n" for line in lines))
