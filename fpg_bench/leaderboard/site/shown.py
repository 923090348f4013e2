"""A board as the pages take it: read once, None for whatever is missing or no number.

A board is data from outside (see :func:`fpg_bench.leaderboard.board.make_board`): a number may be missing,
a text may hold anything. Templates escape all text; what becomes part of a file's name is checked here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fpg_bench.leaderboard.site import wording
from fpg_bench.leaderboard.site.wording import finite

Row = dict[str, Any]
Names = dict[str, dict[str, str]]  # what the players of each side are called, by the names of their folders
_KINDS = ("script", "zoo", "submitted")


@dataclass(frozen=True)
class Score:
    """A score with its interval, and the unit that this speaks of."""

    value: float | None
    low: float | None = None
    high: float | None = None
    over: str = ""


def score_of(found: Any) -> Score | None:
    """What a board says of a score, None where it says nothing."""
    if not isinstance(found, dict) or not found:
        return None
    value, low, high = (finite(found.get(end)) for end in ("value", "low", "high"))
    return Score(value, low, high, str(found.get("over") or ""))


def value_of(score: Score | None) -> float | None:
    """The value of a score, None where there is none."""
    return None if score is None else score.value


def _mapping(found: Any) -> Row:
    return found if isinstance(found, dict) else {}


@dataclass(frozen=True)
class ShownField:
    """A field that a track's entries play: its role, what pages call that, and who is met."""

    role: str
    name: str
    rounds: Any
    counterparts: tuple[str, ...]
    label: str
    about: str


@dataclass(frozen=True)
class ShownEntry:
    """An entry of a track.

    Attributes:
        page: the address of its page, from the site's root.
        row: all that the board says of it.
        score: what it is listed by; ``scores``: over the field of each role.
        worst: the lowest that is known.
        met: by role and counterpart, the score against it.
        measures, seeds, planner, rank: as the board has them, empty where it has none.
    """

    slug: str
    name: str
    page: str
    kind: str
    verified: bool
    row: Row
    rank: Any
    score: Score | None
    scores: Mapping[str, Score]
    worst: Score | None
    met: Mapping[str, Mapping[str, Score | None]]
    measures: Row
    seeds: Row
    planner: Row

    @property
    def gap(self) -> float | None:
        """By how much it scores more against whom everybody knows than against whom nobody had met."""
        known, unseen = (value_of(self.scores.get(role)) for role in ("known", "unseen"))
        return None if known is None or unseen is None else known - unseen

    @property
    def place(self) -> tuple[bool, bool, float, str]:
        """What entries are sorted by: score; those without a rank last, but for those not verified."""
        value = value_of(self.score)
        return not self.verified, not self.rank, -(value if value is not None else -1e9), self.slug


@dataclass(frozen=True)
class ShownTrack:
    """A table of the board; ``entries`` stand by score, ``fields`` in the order in which pages list them."""

    key: str
    title: str
    side: Any
    ranked_by: str
    scale: Any
    fields: tuple[ShownField, ...]
    entries: tuple[ShownEntry, ...]
    improvement: Row
    profiles: Row

    @property
    def other_side(self) -> str:
        """The side whom its entries meet."""
        return "opponent" if self.side == "ally" else "ally"


def read_tracks(board: Row) -> list[ShownTrack]:
    """The tracks of a board.

    Raises:
        UserError: a track or an entry has a name that can't be part of a file's.
    """
    return [_track(row) for row in board["tracks"]]


def names_of(tracks: list[ShownTrack]) -> Names:
    """What the players of each side are called, by the names of their folders."""
    found: Names = {}
    for track in tracks:
        found.setdefault(str(track.side), {}).update({entry.slug: entry.name for entry in track.entries})
    return found


def _track(row: Row) -> ShownTrack:
    key = wording.safe_slug(row["key"], "track")
    places = {role: place for place, role in enumerate(wording.ROLES)}
    fields = sorted(map(_field, row.get("fields") or []), key=lambda f: places.get(f.role, len(places)))
    return ShownTrack(
        key,
        row["title"],
        row.get("side"),
        row.get("ranked_by") or "known",
        row.get("scale"),
        tuple(fields),
        tuple(sorted((read_entry(key, entry) for entry in row["rows"]), key=lambda entry: entry.place)),
        _mapping(row.get("improvement")),
        _mapping(row.get("profiles")),
    )


def _field(row: Row) -> ShownField:
    told = wording.role_of(row["role"])
    counterparts = tuple(row["counterparts"])
    return ShownField(row["role"], row["name"], row.get("rounds"), counterparts, told.label, told.about)


def read_entry(key: str, row: Row) -> ShownEntry:
    """An entry of the track of this key; raises as :func:`read_tracks` does."""
    slug = wording.safe_slug(row["slug"], f"entry of {key}")
    met = {role: _mapping(of) for role, of in _mapping(row.get("counterparts")).items()}
    scores = {role: score_of(of) for role, of in _mapping(row.get("scores")).items()}
    return ShownEntry(
        slug=slug,
        name=row["name"],
        page=f"entries/{key}/{slug}.html",
        kind=kind if (kind := row.get("kind")) in _KINDS else "submitted",
        verified=row.get("status") == "verified",
        row=row,
        rank=row.get("rank"),
        score=score_of(row.get("score")),
        scores={role: score for role, score in scores.items() if score is not None},
        worst=score_of(row.get("worst")),
        met={role: {name: score_of(one) for name, one in of.items()} for role, of in met.items()},
        measures=_mapping(row.get("measures")),
        seeds=_mapping(row.get("seeds")),
        planner=_mapping(row.get("planner")),
    )
