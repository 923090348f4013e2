"""The fields of a season, one for each track, as the files that say who is met and how."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.files import write_whole
from fpg_bench.seasons.season import Season

# By track: whose members are met, and how the opponent flies; None: as each member flew when it was trained.
_TRACKS: dict[str, tuple[str, str | None]] = {
    "ally": ("opponent", None),
    "opponent": ("ally", "pursuit"),
    "opponent-learned": ("ally", "learned"),
    "planner": ("ally", None),
}
MATCHES = 100
_PLANNED = {"rounds_per_match": 10, "opponent": "adaptive", "last_rounds": 3}
_HEAD = "# {track}: the counterparts that were trained after entries were closed. Made by: fpg-bench season close.\n"


def write_fields(season: Season, scales: dict[str, dict[str, float]]) -> list[Path]:
    """Write the fields of a season beside its folder, ``ally-season-1.yml`` and so on.

    Args:
        season: which is closed.
        scales: ``zero`` and ``top`` by track; a track without has returns for scores.

    Returns:
        The files.
    """
    found = []
    for track, (side, path) in _TRACKS.items():
        content: dict[str, Any] = {
            "side": track.partition("-")[0],
            "scenario": "standard",
            "matches": MATCHES,
            **(_PLANNED if track == "planner" else {}),
            **({"scale": scales[track]} if track in scales else {}),
            "season": season.seed,
            "counterparts": list(_counterparts(season, side, None if track == "planner" else path, track)),
        }
        file = season.folder.parent / f"{track}-{season.name}.yml"
        text = yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)
        write_whole(file, _HEAD.format(track=f"{season.name}, {track}") + text)
        found.append(file)
    return found


def _counterparts(season: Season, side: str, path: str | None, track: str) -> Iterator[dict[str, str]]:
    for member in season.members[side]:
        flown = {} if track == "planner" else {"path": path or member.recipe.path}
        yield {"name": member.name, side: f"field:{season.name}/{member.name}", **flown}
