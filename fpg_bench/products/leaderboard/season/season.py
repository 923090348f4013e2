"""Closed seasons: their file, their members, and the suites of their tracks."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import field_validator

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.imports import SUITE
from fpg_bench.common.schema import Items, Strict, parse
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import PLANNER, read_suite
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.players.agent import suites_folder
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.season.entries import SeasonEntry, entries_of_side
from fpg_bench.products.leaderboard.season.recipes import REWARD, Recipe
from fpg_bench.products.leaderboard.season_keys import SeasonKey
from fpg_bench.products.leaderboard.tracks import TRACKS

FILE = "season.yml"
_HEADER = """# The rivals of both sides, how each was trained, and the entries that made the seed.
# Made by: fpg-bench leaderboard close-season. Members lie beside it, as <side>/<member>/policy.onnx.
"""
_MATCHES, _PLANNER_MATCHES = 100, 30  # of each rival; those of planners have many rounds
_MOST_MATCHES = 1200  # of all rivals
_COPIED = ("side", "scenario", "rounds_per_match", "opponent", "last_rounds", "scale")


class SeasonMember(Recipe):
    """A candidate that was selected as a rival of the season suite.

    Attributes:
        policy_sha256: hash of its ``policy.onnx``.
        entries_earn: mean return per step of the other side's entries against it.
    """

    policy_sha256: str
    entries_earn: float


class SeasonCheck(Strict):
    """Verdict of a closing on its members, see :mod:`fpg_bench.products.leaderboard.season.checks`."""

    name: str
    holds: bool
    line: str


class Season(Strict):
    """A closed season, as ``season.yml`` stores it.

    Attributes:
        folder: where it is stored.
        number: the season's number; None for a training population, which earlier versions closed.
        candidates: number of trained candidates by side.
        entries: hashes of each entry's policies by name.
        members: by side, in the order of selection.
        versions: package versions that trained the members.
        scenario: the preset that it is played in.
        checks: verdicts on the members; earlier seasons have none.
    """

    folder: Path
    name: str
    number: int | None
    protocol: str
    seed: str
    candidates: dict[str, int]
    entries: dict[str, list[str]]
    members: dict[str, Items[SeasonMember]]
    versions: dict[str, str]
    scenario: str = "standard"
    checks: Items[SeasonCheck] = ()

    @field_validator("members")
    @classmethod
    def _check_sides(cls, members: dict[str, Items[SeasonMember]]) -> dict[str, Items[SeasonMember]]:
        if members.keys() != set(SIDES):
            raise UserError(f"expected members of {' and '.join(SIDES)}, got {', '.join(members) or 'none'}")
        return members

    @property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result: name, protocol, seed and policies."""
        policies = [f"{side} {member.path} {member.policy_sha256}" for side, member in self.all_members()]
        content = "/".join([self.name, self.protocol, self.seed, *policies])
        return hashlib.sha256(content.encode()).hexdigest()

    def agent(self, side: str, member: SeasonMember) -> Path:
        """Return a member's agent folder."""
        return self.folder / side / member.name

    def all_members(self) -> Iterator[tuple[str, SeasonMember]]:
        """Yield all members with their sides."""
        for side in SIDES:
            for member in self.members[side]:
                yield side, member


def write_season(season: Season) -> None:
    """Write ``season.yml``; its presence marks the season as closed, so it is written last."""
    _write_yaml(season.folder / FILE, _HEADER, season.model_dump(exclude={"folder"}))


def write_suites(season: Season, number: int) -> None:
    """Write the suites of all tracks, with the season's members as rivals.

    Args:
        season: a closed season.
        number: its number.
    """
    key = SeasonKey(number, season.seed)
    for track in TRACKS.values():
        if track.scenario != season.scenario:
            continue
        side, is_planner = other_side(track.side), track.side == PLANNER
        template = read_yaml(suites_folder() / f"{track.public}.yml", "suite")
        content: dict[str, Any] = {name: template[name] for name in _COPIED if name in template}
        matches = _MOST_MATCHES // len(season.members[side])
        most = _PLANNER_MATCHES if is_planner else _MATCHES
        content |= {"matches": min(matches, most), "season": season.seed}
        content["rivals"] = [
            {"name": member.name, side: f"{season.name}/{side}/{member.name}"}
            | ({} if is_planner else {"path": track.path or member.path})
            for member in season.members[side]
        ]
        header = f"# The members of {season.name}, trained after entries were closed."
        header += " Made by: fpg-bench leaderboard close-season.\n"
        file = season.folder.parent / f"{key.suite_name(track.public)}.yml"
        _write_yaml(file, header, content)
        content["scale"] |= {"random": round(_random_play(season, file), 2)}
        _write_yaml(file, header, content)


def _random_play(season: Season, file: Path) -> float:
    """Return what random play earns per step under a suite of a season."""
    suite = read_suite(str(file))
    members = season.members[suite.other_side]
    suite = dataclasses.replace(
        suite,
        rivals=tuple(
            dataclasses.replace(rival, players=(str(season.agent(suite.other_side, member)),))
            for rival, member in zip(suite.rivals, members, strict=True)
        ),
    )
    records = [play(player_entry("random"), suite, rival) for rival in suite.rivals]
    return summary_of(records, suite).reward.value


def _write_yaml(path: Path, header: str, content: dict[str, object]) -> None:
    text = yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)
    write_whole(path, header + text)


def load_season(name: str | Path) -> Season:
    """Load a shipped season by name (``season-4``) or one in a folder, and check its members.

    Raises:
        UserError: no such season, an invalid file, or a policy with another hash.
    """
    folder = season_folder(name)
    where = f"season {folder}"
    content = read_yaml(folder / FILE, "season")
    season = parse(Season, content | {"folder": folder}, f"{where}: {FILE}")
    for side, member in season.all_members():
        policy = season.agent(side, member) / "policy.onnx"
        if not policy.is_file():
            raise UserError(f"{where}: member {member.name}: {policy} is missing")
        if hashlib.sha256(policy.read_bytes()).hexdigest() != member.policy_sha256:
            raise UserError(f"{where}: member {member.name}: {policy} is not the file of {FILE} (sha256)")
    return season


def season_folder(name: str | Path) -> Path:
    """Return the folder of a shipped season, or the folder itself.

    Raises:
        UserError: neither exists.
    """
    for folder in (suites_folder() / name, Path(name)):
        if (folder / FILE).is_file():
            return folder
    raise UserError(f"season: no {str(name)!r}; closed are: {', '.join(_closed()) or 'none yet'}")


def _closed() -> list[str]:
    return sorted(file.parent.name for file in suites_folder().glob(f"*/{FILE}"))


def target_pool(entries: Sequence[SeasonEntry], side: str, scenario: str, name: str) -> list[SeasonEntry]:
    """Return the players of a side that candidates of the suite ``name`` are trained against.

    They are the entries, and the members of all suites that were closed before and are paid by their own
    reward.
    """
    pool = entries_of_side(entries, side)
    for season in map(load_season, _closed()):
        if season.scenario == scenario and season.name != name:
            pool += [
                SeasonEntry(spec, side, member.path if side == "opponent" else None, (spec,))
                for member in season.members[side]
                if member.reward == REWARD
                for spec in [f"{SUITE}{season.name}/{member.name}"]
            ]
    return pool
