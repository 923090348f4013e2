"""Closed seasons: the entries they were closed over, their members, and the suites of their tracks."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import field_validator

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.schema import Items, Strict, parse
from fpg_bench.evaluation.seeds import SeasonKey, seed_from
from fpg_bench.evaluation.suite import PLANNER
from fpg_bench.leaderboard.folders import submission_folders
from fpg_bench.leaderboard.submission import read_submission
from fpg_bench.leaderboard.tracks import TRACKS
from fpg_bench.players.agent import baselines_folder, suites_folder
from fpg_bench.players.player import SIDES

FILE = "season.yml"
_HEADER = """# The rivals of both sides, how each was trained, and the entries that made the seed.
# Made by: fpg-bench leaderboard close-season. Members lie beside it, as <side>/<member>/policy.onnx.
"""
_MATCHES, _PLANNER_MATCHES = 100, 30  # of each rival; those of planners have many rounds
_COPIED = ("side", "scenario", "rounds_per_match", "opponent", "last_rounds", "scale")


@dataclass(frozen=True)
class SeasonEntry:
    """A submission that a season is closed over.

    Attributes:
        name: ``track/slug``, as on the board.
        side: ``ally`` or ``opponent``; None for planners, which no candidate can be trained against.
        flight: an opponent's path: ``pursuit`` or ``learned``.
        scenario: the preset that it plays.
        players: one per training seed, or the script; see :func:`fpg_bench.players.registry.as_player`.
        hashes: SHA-256 of each policy; a script's name, or the hash of a planner's submission.
    """

    name: str
    side: str | None
    flight: str | None
    players: tuple[str, ...]
    hashes: tuple[str, ...] = ()
    scenario: str = "standard"

    @property
    def path(self) -> str:
        """The opponent's path in its rounds."""
        return self.flight or "pursuit"

    @property
    def is_script(self) -> bool:
        """The entry names a script, which was not trained and plays on any path."""
        return "/" not in self.players[0]


def read_entries(
    board: str | Path = "leaderboard", inspect_onnx: bool = True, scenario: str = "standard"
) -> list[SeasonEntry]:
    """Read the accepted entries of a board that play a scenario, sorted by track and name.

    Args:
        board: the leaderboard's folder.
        inspect_onnx: inspect each ONNX file; not needed if no policy is played.
        scenario: the preset.

    Raises:
        UserError: no board there, or an invalid submission.
    """
    folders = submission_folders(Path(board))
    if not folders:
        raise UserError(f"season: {board} holds no submissions; name the leaderboard's folder")
    entries = [_read_entry(folder, inspect_onnx) for folder in folders]
    return [entry for entry in entries if entry.scenario == scenario]


def _read_entry(folder: Path, inspect_onnx: bool) -> SeasonEntry:
    submission, problems = read_submission(folder, inspect_onnx)
    name = f"{folder.parent.name}/{folder.name}"
    if submission is None:
        raise UserError(f"season: entry {name}: {problems[0]}")
    side = submission.track if submission.track in SIDES else None
    hashes = tuple(policy.sha256 for policy in submission.policies)
    if not hashes:
        script = f"script {submission.track} {submission.script}"
        hashes = (submission.fingerprint if side is None else script,)
    return SeasonEntry(name, side, submission.path, submission.players, hashes, submission.scenario)


def entries_of_side(entries: Sequence[SeasonEntry], side: str) -> list[SeasonEntry]:
    """Return the entries of a side; of the same player (a script entered for both paths) only the first.

    It stands in the place of the last: draws depend on this order.
    """
    by_players = {entry.players: entry for entry in reversed(entries) if entry.side == side}
    return list(by_players.values())[::-1]


def season_seed(protocol: str, number: int | str, entries: Sequence[SeasonEntry]) -> str:
    """Return the seed of a season that is closed over these entries."""
    return seed_from(protocol, number, [value for entry in entries for value in entry.hashes])


class Recipe(Strict):
    """Training configuration of one candidate.

    Attributes:
        name: the candidate's name in the suite.
        side: the side it plays.
        log_std: initial log standard deviation of PPO's actions; None for TD3.
        targets: the players it is trained against, one drawn per round.
        path: the opponent's path during training.
    """

    name: str
    side: str
    algorithm: str
    steps: int
    reward: str
    gamma: float
    log_std: float | None
    targets: Items[str]
    path: str
    training_seed: int


class SeasonMember(Recipe):
    """A candidate that was selected as a rival of the season suite.

    Attributes:
        policy_sha256: hash of its ``policy.onnx``.
        entries_earn: mean return per step of the other side's entries against it.
        group: its group in the suite; None in seasons without groups.
    """

    policy_sha256: str
    entries_earn: float
    group: str | None = None


class Season(Strict):
    """A closed season, as ``season.yml`` stores it.

    Attributes:
        folder: where it is stored.
        number: the season's number; None for a training population, which ranks no board.
        candidates: number of trained candidates by side.
        entries: hashes of each entry's policies by name.
        members: by side, in the order of selection.
        versions: package versions that trained the members.
        scenario: the preset that it is played in.
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

    @field_validator("members")
    @classmethod
    def _check_sides(cls, members: dict[str, Any]) -> dict[str, Any]:
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
        content |= {"matches": _PLANNER_MATCHES if is_planner else _MATCHES, "season": season.seed}
        content["rivals"] = [
            {"name": member.name, side: f"{season.name}/{side}/{member.name}"}
            | ({} if is_planner else {"path": track.path or member.path})
            | ({} if member.group is None else {"group": member.group})
            for member in season.members[side]
        ]
        header = f"# The members of {season.name}, trained after entries were closed."
        header += " Made by: fpg-bench leaderboard close-season.\n"
        _write_yaml(season.folder.parent / f"{key.suite_name(track.public)}.yml", header, content)


def _write_yaml(path: Path, header: str, content: dict[str, Any]) -> None:
    text = yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)
    write_whole(path, header + text)


def load_season(name: str | Path) -> Season:
    """Load a shipped season by name (``season-1``) or one in a folder, and check its members.

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
    suites = baselines_folder() / "suites"
    for folder in (suites / name, Path(name)):
        if (folder / FILE).is_file():
            return folder
    known = sorted(file.parent.name for file in suites.glob(f"*/{FILE}"))
    raise UserError(f"season: no {str(name)!r}; closed are: {', '.join(known) or 'none yet'}")
