"""Tracks of the board, and the suites that their entries play."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from fpg_bench.evaluation.suite import Suite, load_suite, suite_names
from fpg_bench.products.leaderboard.season_keys import SeasonKey, current_seasons

PUBLIC, UNSEEN, SHIFTED, RESPONSES = "public", "unseen", "shifted", "responses"
TRANSCRIPT_MATCHES = 4  # of each ally: 200 plans in all, which a small or paid model can be asked for


@dataclass(frozen=True)
class Track:
    """A track of the board, which has a table of its own.

    Attributes:
        key: its name.
        side: what is entered, and the folder of its submissions: ``ally``, ``opponent`` or ``planner``.
        path: how opponents fly: ``pursuit`` or ``learned``; None for others.
        title: its title on the page.
        public: the name of the public suite.
        scenario: the preset that its entries play.
    """

    key: str
    side: str
    path: str | None
    title: str
    public: str
    scenario: str = "standard"

    def suite_name(self, role: str) -> str:
        """Return the name of its suite of a role: ``ally-v2`` becomes ``ally-shifted-v2``."""
        stem, _, version = self.public.rpartition("-v")
        return f"{stem}-{role}-v{version}"


class TrackSuites:
    """Loader of the suites of tracks, which loads each of them once."""

    def __init__(self) -> None:
        self._loaded: dict[str, Suite] = {}
        self._played: dict[tuple[str, bool], dict[str, Suite]] = {}

    @cached_property
    def seasons(self) -> Mapping[str, SeasonKey]:
        """The newest closed season of each scenario; none before the first one is closed."""
        return current_seasons()

    def season(self, track: Track) -> SeasonKey | None:
        """Return the season that ranks a track; None before the first one of its scenario is closed."""
        return self.seasons.get(track.scenario)

    def public(self, track: Track) -> Suite:
        """Return the public suite of a track."""
        return self._load(track.public)

    def of(self, track: Track, transcripts: bool = False) -> Mapping[str, Suite]:
        """Return the suites that an entry of a track plays, by role.

        ``public`` is the public suite, ``unseen`` that of the season, ``shifted`` trained rivals under
        changed rules, ``responses`` best responses to single entries. The evaluation seeds of the season's
        suite follow from its seed, which nobody knew before entries were closed; those of others are public.

        Args:
            track: the track.
            transcripts: true for a language model's entry, recorded on the first matches on public seeds.
        """
        key = track.key, transcripts
        if key not in self._played:
            self._played[key] = self._suites(track, transcripts)
        return self._played[key]

    def _suites(self, track: Track, transcripts: bool) -> dict[str, Suite]:
        public = self.public(track)
        if transcripts:
            return {PUBLIC: dataclasses.replace(public, matches=min(public.matches, TRANSCRIPT_MATCHES))}
        season = self.season(track)
        names = {} if season is None else {UNSEEN: season.suite_name(track.public)}
        names |= {role: track.suite_name(role) for role in (SHIFTED, RESPONSES)}
        shipped = suite_names()
        return {PUBLIC: public} | {role: self._load(name) for role, name in names.items() if name in shipped}

    def _load(self, name: str) -> Suite:
        if name not in self._loaded:
            self._loaded[name] = load_suite(name, shipped=True)
        return self._loaded[name]


def ranked_by(roles: Collection[str]) -> str:
    """Return the role of the suite that ranks: the unseen one if entries play it, else the public one."""
    return UNSEEN if UNSEEN in roles else PUBLIC


TRACKS = MappingProxyType(
    {
        track.key: track
        for track in (
            Track("ally", "ally", None, "Allies", "ally-v2"),
            Track("opponent-pursuit", "opponent", "pursuit", "Opponents in pursuit", "opponent-v2"),
            Track(
                "opponent-learned",
                "opponent",
                "learned",
                "Opponents that fly themselves",
                "opponent-learned-v2",
            ),
            Track("planner", "planner", None, "Planners of the opponent's path", "planner-v1"),
            Track("ally-link", "ally", None, "Allies on a radio link", "ally-link-v1", "link"),
            Track(
                "opponent-link",
                "opponent",
                "pursuit",
                "Opponents on a radio link",
                "opponent-link-v1",
                "link",
            ),
        )
    }
)


SCENARIOS = tuple(dict.fromkeys(track.scenario for track in TRACKS.values()))


def track_of(side: str, path: str | None, scenario: str) -> Track:
    """Return the track of a submission by its side, path and scenario."""
    key = (side, path, scenario)
    return next(track for track in TRACKS.values() if (track.side, track.path, track.scenario) == key)
