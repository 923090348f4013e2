"""What the front page shows: a round that moves, and the first three of each track."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.drawing import Domain
from fpg_bench.leaderboard.site.shown import Names, Row, Score, ShownEntry, ShownTrack, value_of
from fpg_bench.leaderboard.site.views import entry_head, worst_view
from fpg_bench.leaderboard.site.wording import written

if TYPE_CHECKING:
    from fpg_bench.leaderboard.site.replays import Replay

FIRST = 3
_STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # of an axis' marks
_TICKS = 5  # at most


def front_view(
    tracks: Sequence[ShownTrack], names: Names, replays: Mapping[tuple[str, str], Sequence[Replay]]
) -> Row:
    """What the front page shows.

    Args:
        tracks: of a board.
        names: see :func:`fpg_bench.leaderboard.site.shown.names_of`.
        replays: by track and entry, the rounds that its page shows.
    """
    return {"film": _film(tracks, replays), "tracks": [_podium(track, names) for track in tracks]}


def _film(tracks: Sequence[ShownTrack], replays: Mapping[tuple[str, str], Sequence[Replay]]) -> Replay | None:
    """The round that moves: the last (hardest) one of the first entry that has any; None where none has."""
    ranked = [(track.key, entry.slug) for track in tracks for entry in track.entries]
    return next((replays[place][-1] for place in ranked if replays.get(place)), None)


def _podium(track: ShownTrack, names: Names) -> Row:
    """The first three of a track, their scores and worst cases on one axis that spans what they reach."""
    first = [entry for entry in track.entries if entry.verified and entry.score is not None][:FIRST]
    domain = zoomed([score for entry in first for score in (entry.score, entry.worst)])
    return {
        "key": track.key,
        "title": track.title,
        "side": "ally" if track.side == "ally" else "opponent",
        "count": len(track.entries),
        "ranked_by": wording.role_of(track.ranked_by).label.lower(),
        "ticks": [
            {"x": drawing.place(tick, domain), "text": written(tick, "whole")} for tick in ticks(domain)
        ],
        "rows": [_row(track, entry, domain, names) for entry in first],
    }


def _row(track: ShownTrack, entry: ShownEntry, domain: Domain, names: Names) -> Row:
    return {
        **entry_head(entry),
        "score": written(value_of(entry.score)),
        "interval": wording.interval_text(entry.score),
        "picture": drawing.interval_picture(entry.score, domain),
        "worst": worst_view(track, entry, names),
        "worst_picture": drawing.interval_picture(entry.worst, domain),
    }


def zoomed(scores: Sequence[Score | None]) -> Domain:
    """The scores that an axis spans which is no longer than what stands on it; 0 to 100 for nothing."""
    ends = drawing.ends_of(scores)
    if not ends:
        return 0.0, 100.0
    margin = max((max(ends) - min(ends)) * 0.05, 0.5)
    return min(ends) - margin, max(ends) + margin


def ticks(domain: Domain) -> list[int]:
    """Round numbers within a domain, at most five."""
    low, high = domain
    step = next((one for one in _STEPS if (high - low) / one <= _TICKS), 10 * _STEPS[-1])
    return list(range(math.ceil(low / step) * step, math.floor(high / step) * step + 1, step))
