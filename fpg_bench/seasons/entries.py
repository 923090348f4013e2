"""The entries that a season is closed over: what was accepted on the board, by the hashes of its policies."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import seed_from
from fpg_bench.leaderboard.check import examine
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.submission import TRACKS, Submission
from fpg_bench.players.player import SIDES
from fpg_bench.seasons.recipe import Target


@dataclass(frozen=True)
class SeasonEntry:
    """One accepted submission.

    Attributes:
        name: ``track/slug``, as the board calls it.
        side: ``ally`` or ``opponent``; None for planners, which no candidate can be trained against.
        flight: how an opponent flies: ``pursuit`` or ``learned``.
        players: by training seed, or the script itself; see :func:`fpg_bench.players.naming.as_player`.
        hashes: SHA-256 of each player's policy; of a script its name, of a planner what was submitted.
    """

    name: str
    side: str | None
    flight: str | None
    players: tuple[str, ...]
    hashes: tuple[str, ...]

    @property
    def path(self) -> str:
        """The path that its rounds are flown on."""
        return self.flight or "pursuit"

    def target(self) -> Target:
        """As candidates are trained against it; a script flies in either game."""
        found = Target(self.name, self.players, self.flight)
        return dataclasses.replace(found, flight=None) if found.scripted else found


def read_entries(board: str | Path = "leaderboard", contract: bool = True) -> list[SeasonEntry]:
    """The accepted entries of a board, by track and name.

    Args:
        board: the leaderboard's folder.
        contract: whether to check what their policies hold; needless where nobody plays them.

    Raises:
        UserError: no board there, or a submission that is not sound.
    """
    root = Path(board) / "submissions"
    folders = sorted(folder for track in TRACKS for folder in (root / track).glob("*") if folder.is_dir())
    if not folders:
        raise UserError(f"season: {root} holds no submissions; name the leaderboard's folder")
    return [_entry(folder, contract) for folder in folders]


def season_seed(protocol: str, number: int | str, entries: Sequence[SeasonEntry]) -> str:
    """The seed of a season that is closed over these entries."""
    return seed_from(protocol, number, [of for entry in entries for of in entry.hashes])


def of_side(entries: Sequence[SeasonEntry], side: str) -> list[SeasonEntry]:
    """The entries that play a side."""
    return [entry for entry in entries if entry.side == side]


def _entry(folder: Path, contract: bool) -> SeasonEntry:
    submission, found = examine(folder, contract)
    name = f"{folder.parent.name}/{folder.name}"
    if submission is None or found:
        raise UserError(f"season: entry {name}: {found[0]}")
    side = submission.track if submission.track in SIDES else None
    hashes = tuple(policy.sha256 for policy in submission.policies)
    own = submission.fingerprint if side is None else f"script {submission.track} {submission.script}"
    return SeasonEntry(name, side, submission.path, _players(submission), hashes or (own,))


def _players(submission: Submission) -> tuple[str, ...]:
    if submission.script is not None:
        return (submission.script,)
    home = submission.zoo or brief(submission.folder)
    return tuple(f"{home}/seed_{policy.seed}" for policy in submission.policies)


def apart(entries: Sequence[SeasonEntry]) -> list[SeasonEntry]:
    """The entries without those that play as an earlier one does: a script entered for both ways to fly."""
    return list({entry.players: entry for entry in reversed(entries)}.values())[::-1]
