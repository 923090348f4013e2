"""Entries of the board that a season is closed over, and the seed that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.cases import board_reader
from fpg_bench.products.leaderboard.folders import submission_folders
from fpg_bench.products.leaderboard.season_keys import seed_from
from fpg_bench.products.leaderboard.submission import Reader, Refusal, admit


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
    reader = board_reader(Path(board))
    entries = [_read_entry(folder, reader, inspect_onnx) for folder in folders]
    return [entry for entry in entries if entry.scenario == scenario]


def _read_entry(folder: Path, reader: Reader, inspect_onnx: bool) -> SeasonEntry:
    name = f"{folder.parent.name}/{folder.name}"
    try:
        submission = admit(folder, reader, inspect_onnx)
    except Refusal as refusal:
        raise UserError(f"season: entry {name}: {refusal.lines[0]}") from refusal
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
