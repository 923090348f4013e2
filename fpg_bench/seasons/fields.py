"""The fields of a season: its members as the counterparts of every track, as YAML files beside its folder."""

from __future__ import annotations

from typing import Any

import yaml

from fpg_bench.evaluation.seeds import SeasonKey
from fpg_bench.files import read_yaml, write_whole
from fpg_bench.players.agent import fields_folder
from fpg_bench.seasons.season import Season

# By public field: the other side, how it is met (an opponent as it was trained), and the matches.
_TRACKS: dict[str, tuple[str, str | None, int]] = {
    "ally-v1": ("opponent", None, 100),
    "opponent-v1": ("ally", "pursuit", 100),
    "opponent-learned-v1": ("ally", "learned", 100),
    "planner-v1": ("ally", None, 30),
}
_COPIED = ("side", "scenario", "rounds_per_match", "opponent", "last_rounds", "scale")


def write_fields(season: Season, number: int) -> list[str]:
    """Write the fields of all tracks; gives their names.

    Args:
        season: that was closed.
        number: its number.
    """
    key, found = SeasonKey(number, season.seed), []
    for public, (side, path, matches) in _TRACKS.items():
        like = read_yaml(fields_folder() / f"{public}.yml", "field")
        content: dict[str, Any] = {name: like[name] for name in _COPIED if name in like}
        content |= {"matches": matches, "season": season.seed}
        content["counterparts"] = [
            {
                "name": member.name,
                side: f"{season.name}/{side}/{member.name}",
                **({"path": path or member.recipe.path} if public != "planner-v1" else {}),
            }
            for member in season.members[side]
        ]
        name = key.field_name(public)
        head = f"# The members of {season.name}, whom no entry had met. Made by: fpg-bench season close.\n"
        text = yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)
        write_whole(season.folder.parent / f"{name}.yml", head + text)
        found.append(name)
    return found
