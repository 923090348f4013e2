"""View model of the front page: a moving round, and the first three entries of each track."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fpg_bench.leaderboard.board import Board, BoardEntry, BoardTrack, Figures, Score
from fpg_bench.leaderboard.site.replays import Replay
from fpg_bench.leaderboard.site.views import Axis, WorstView, entry_page, interval_ends, worst_view

FIRST = 3
_STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # between an axis' ticks
_MOST_TICKS = 5


@dataclass(frozen=True)
class PodiumRow:
    """One of the first entries of a track."""

    entry: BoardEntry
    page: str
    figures: Figures
    worst: WorstView


@dataclass(frozen=True)
class Podium:
    """The first entries of a track; their scores and worst cases share one axis."""

    track: BoardTrack
    axis: Axis
    ticks: list[int]
    rows: list[PodiumRow]

    @property
    def side(self) -> str:
        """The side that is flown: a planner's is the opponent."""
        return "ally" if self.track.side == "ally" else "opponent"


@dataclass(frozen=True)
class FrontView:
    """The front page: the round that moves, if there is one, and the podiums."""

    film: Replay | None
    podiums: list[Podium]


def front_view(board: Board, replays: Mapping[tuple[str, str], Sequence[Replay]]) -> FrontView:
    """Return the view of the front page.

    Args:
        board: the board.
        replays: rounds by track and entry. The page shows the last (hardest) of the first entry that has any.
    """
    entries = [(track.key, entry.slug) for track in board.tracks for entry in track.entries]
    film = next((replays[key][-1] for key in entries if replays.get(key)), None)
    return FrontView(film, [_podium(board, track) for track in board.tracks])


def _podium(board: Board, track: BoardTrack) -> Podium:
    first = list(track.verified())[:FIRST]
    axis = zoomed_axis(score for _, figures in first for score in (figures.score, figures.worst.score))
    rows = [
        PodiumRow(entry, entry_page(track, entry), figures, worst_view(board, track, figures))
        for entry, figures in first
    ]
    return Podium(track, axis, ticks(axis), rows)


def zoomed_axis(scores: Iterable[Score]) -> Axis:
    """Return an axis that spans just the scores; 0 to 100 without any."""
    ends = interval_ends(scores)
    if not ends:
        return Axis(0.0, 100.0)
    margin = max((max(ends) - min(ends)) * 0.05, 0.5)
    return Axis(min(ends) - margin, max(ends) + margin)


def ticks(axis: Axis) -> list[int]:
    """Return at most five round numbers on an axis."""
    step = next((step for step in _STEPS if (axis.high - axis.low) / step <= _MOST_TICKS), 10 * _STEPS[-1])
    return list(range(math.ceil(axis.low / step) * step, math.floor(axis.high / step) * step + 1, step))
