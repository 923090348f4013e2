"""A closed season: what ``season.yml`` says, whether the members beside it are its own, and its fields."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import SeasonKey
from fpg_bench.files import read_yaml, write_whole
from fpg_bench.players.agent import baselines_folder, fields_folder
from fpg_bench.players.player import SIDES
from fpg_bench.seasons.recipe import Recipe, digest

FILE = "season.yml"
_KEYS = ("name", "number", "protocol", "seed", "candidates", "entries", "members", "versions")
_HEAD = """# The counterparts of both sides, how each was trained, and the entries that made the seed.
# Made by: fpg-bench season close. Members lie beside it, as <side>/<member>/policy.onnx.
"""
# By public field: the other side, how it is met (an opponent as it was trained), and the matches.
_TRACKS: dict[str, tuple[str, str | None, int]] = {
    "ally-v1": ("opponent", None, 100),
    "opponent-v1": ("ally", "pursuit", 100),
    "opponent-learned-v1": ("ally", "learned", 100),
    "planner-v1": ("ally", None, 30),
}
_COPIED = ("side", "scenario", "rounds_per_match", "opponent", "last_rounds", "scale")


@dataclass(frozen=True)
class SeasonMember:
    """A counterpart of a field.

    Attributes:
        recipe: how it was trained.
        policy_sha256: of its ``policy.onnx``.
        entries_earn: what the entries of the other side earn a step against it on average.
    """

    recipe: Recipe
    policy_sha256: str
    entries_earn: float

    @property
    def name(self) -> str:
        """What the field calls it."""
        return self.recipe.name


@dataclass(frozen=True)
class Season:
    """What was closed.

    Attributes:
        folder: where it lies.
        number: of the season; None for a training population, over which no board is ranked.
        candidates: how many were trained, by side.
        entries: the hashes of each entry's policies, by name.
        members: by side, in the order in which they were chosen.
    """

    folder: Path
    name: str
    number: int | None
    protocol: str
    seed: str
    candidates: dict[str, int]
    entries: dict[str, list[str]]
    members: dict[str, tuple[SeasonMember, ...]]
    versions: dict[str, str]

    @property
    def hash(self) -> str:
        """SHA-256 of what decides a result on it: its name, protocol, seed and the policies."""
        chosen = [f"{side} {m.recipe.path} {m.policy_sha256}" for side in SIDES for m in self.members[side]]
        return digest(self.name, self.protocol, self.seed, *chosen)

    def agent(self, side: str, member: SeasonMember) -> Path:
        """A member's agent folder."""
        return self.folder / side / member.name

    def everyone(self) -> Iterator[tuple[str, SeasonMember]]:
        """All members with their sides."""
        for side in SIDES:
            for member in self.members[side]:
                yield side, member


def write_season(season: Season) -> None:
    """Write ``season.yml``, whole and last: where it is, the season is closed."""
    content = {key: getattr(season, key) for key in _KEYS}
    content["members"] = {side: [_words(member) for member in season.members[side]] for side in SIDES}
    _write_yaml(season.folder / FILE, _HEAD, content)


def write_fields(season: Season, number: int) -> list[str]:
    """Write the fields of all tracks, with the season's members as counterparts; gives their names.

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
        _write_yaml(season.folder.parent / f"{name}.yml", head, content)
        found.append(name)
    return found


def _write_yaml(path: Path, head: str, content: dict[str, Any]) -> None:
    text = yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)
    write_whole(path, head + text)


def load_season(name: str | Path) -> Season:
    """A shipped season by its name (``season-1``), or one in a folder; its members are checked.

    Raises:
        UserError: none there, a file that is cut off or says something else, or a policy that is another.
    """
    folder = season_folder(name)
    where = f"season {folder}"
    content = read_yaml(folder / FILE, "season")
    if missing := [key for key in _KEYS if key not in content]:
        raise UserError(f"{where}: {FILE} lacks {missing[0]!r}")
    try:
        members = {side: tuple(map(_member, content["members"][side])) for side in SIDES}
        named = {key: content[key] for key in _KEYS if key != "members"}
        season = Season(folder=folder, members=members, **named)
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{where}: {FILE}: members: {type(error).__name__}: {error}") from error
    for side, member in season.everyone():
        _check(season.agent(side, member), member, where)
    return season


def season_folder(name: str | Path) -> Path:
    """The folder of a shipped field, or a folder itself.

    Raises:
        UserError: neither.
    """
    fields = baselines_folder() / "fields"
    for folder in (fields / name, Path(name)):
        if (folder / FILE).is_file():
            return folder
    known = sorted(file.parent.name for file in fields.glob(f"*/{FILE}"))
    raise UserError(f"season: no {str(name)!r}; closed are: {', '.join(known) or 'none yet'}")


def _words(member: SeasonMember) -> dict[str, Any]:
    return member.recipe.words() | {
        "policy_sha256": member.policy_sha256,
        "entries_earn": member.entries_earn,
    }


def _member(words: dict[str, Any]) -> SeasonMember:
    words = dict(words)
    sha256, earn = str(words.pop("policy_sha256")), float(words.pop("entries_earn"))
    return SeasonMember(Recipe(**words | {"targets": tuple(words["targets"])}), sha256, earn)


def _check(agent: Path, member: SeasonMember, where: str) -> None:
    """Raise UserError where a member's policy is not the file that ``season.yml`` speaks of."""
    policy = agent / "policy.onnx"
    if not policy.is_file():
        raise UserError(f"{where}: member {member.name}: {policy} is missing")
    if hashlib.sha256(policy.read_bytes()).hexdigest() != member.policy_sha256:
        raise UserError(f"{where}: member {member.name}: {policy} is not the file of {FILE} (sha256)")
