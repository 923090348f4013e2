"""Tracks: what entries of one kind play, and which numbers are made of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass
from types import MappingProxyType

from fpg_bench.evaluation.seeds import SEASON, SeasonKey, current_season
from fpg_bench.evaluation.suite import Suite, load_suite
from fpg_bench.players.agent import suites_folder

PUBLIC, PUBLIC_SEEDS, UNSEEN, SHIFTED, RESPONSES = "public", "public-seeds", "unseen", "shifted", "responses"
PUBLIC_SEEDS_MATCHES = 25  # on seeds that everybody knew: only to see whether they were learned by heart
TRANSCRIPT_MATCHES = 20  # of each ally: a fifth of the tokens of the suite's 100, for wider intervals


@dataclass(frozen=True)
class Track:
    """A table of the board.

    Attributes:
        key: its name.
        side: who is entered, and the folder of submissions: ``ally``, ``opponent`` or ``planner``.
        path: of opponents, how they fly; else None.
        title: what the page calls it.
        public: the name of the suite that everybody knows.
    """

    key: str
    side: str
    path: str | None
    title: str
    public: str

    @property
    def suite(self) -> Suite:
        """The suite that everybody knows."""
        return load_suite(self.public, shipped=True)

    def suites(self, transcripts: bool = False, season: SeasonKey | None = None) -> dict[str, Suite]:
        """What an entry plays, by what it says of it.

        ``known`` is the public suite, ``unseen`` that of the season, ``shifted`` the public one under changed
        rules: all on seeds that follow from the season's, which nobody knew before entries were closed.
        ``public`` is the first again on seeds that everybody knew. ``responses`` are best responses to
        single entries. Before a season is closed all is played on the seeds that everybody knows.

        Args:
            transcripts: whether the entry is a language model's, recorded on the first public matches.
            season: the season that is on; None: the newest one that is closed.
        """
        season = season or current_season()
        public = self.suite
        if transcripts:
            return {PUBLIC: dataclasses.replace(public, matches=min(public.matches, TRANSCRIPT_MATCHES))}
        seeds = SEASON if season is None else season.seed
        found = {PUBLIC: dataclasses.replace(public, season=seeds)}
        others = {}
        if season is not None:
            found[PUBLIC_SEEDS] = dataclasses.replace(
                public, matches=min(public.matches, PUBLIC_SEEDS_MATCHES)
            )
            others[UNSEEN] = season.suite_name(self.public)
        stem = self.public.removesuffix("-v1")
        others |= {SHIFTED: f"{stem}-shifted-v1", RESPONSES: f"{stem}-responses-v1"}
        for role, name in others.items():
            if (suites_folder() / f"{name}.yml").is_file():
                found[role] = dataclasses.replace(load_suite(name, shipped=True), season=seeds)
        return found


def ranked_by(suites: Collection[str]) -> str:
    """What ranks entries that play these suites: the unseen one where there is one, else the known one."""
    return UNSEEN if UNSEEN in suites else PUBLIC


TRACKS = MappingProxyType(
    {
        track.key: track
        for track in (
            Track("ally", "ally", None, "Allies", "ally-v1"),
            Track("opponent-pursuit", "opponent", "pursuit", "Opponents in pursuit", "opponent-v1"),
            Track(
                "opponent-learned",
                "opponent",
                "learned",
                "Opponents that fly themselves",
                "opponent-learned-v1",
            ),
            Track("planner", "planner", None, "Planners of the opponent's path", "planner-v1"),
        )
    }
)


def track_of(side: str, path: str | None) -> Track:
    """The track of a submission; the one of its side where it names no path."""
    return next(track for track in TRACKS.values() if (track.side, track.path) == (side, path))
