"""Whom the page can play: a script, an agent of the zoo, or a submitted policy; by entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.site.play_data import Zoo, agent_file, policy_data, submitted_file
from fpg_bench.leaderboard.site.shown import Row, ShownEntry, ShownTrack, read_tracks
from fpg_bench.players.player import SIDES
from fpg_bench.players.scripts import ALLIES, OPPONENTS

Policies = Mapping[tuple[str, str], dict[str, Any]]


def submitted_policies(board: Row, folder: str | Path) -> dict[tuple[str, str], dict[str, Any]]:
    """The first training seed's policy of each verified, submitted entry that the page can play.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives.
        folder: the leaderboard's, which holds the submissions.

    Returns:
        By track and entry, what :func:`fpg_bench.leaderboard.site.play_data.policy_data` gives.
    """
    found = {}
    for track in read_tracks(board):
        for entry in track.entries:
            if track.side in SIDES and entry.verified and entry.kind == "submitted":
                policy = _first_policy(Path(folder) / "submissions" / str(track.side) / entry.slug)
                if policy is not None:
                    found[track.key, entry.slug] = policy
    return found


def _first_policy(home: Path) -> dict[str, Any] | None:
    try:
        policies = load_submission(home, contract=False).policies
        return policy_data(min(policies, key=lambda one: one.seed).model) if policies else None
    except UserError:
        return None  # submit verify says what is wrong


def watched(tracks: Sequence[ShownTrack], policies: Policies, zoo: Zoo) -> dict[str, dict[str, Row]]:
    """By side and entry, the player that stands for it on the page, and the path that it flies.

    Entries are left out that the page can't play.
    """
    found = {side: dict[str, Row]() for side in SIDES}
    for track in tracks:
        for entry in track.entries:
            player = _player(track, entry, policies, zoo)
            if track.side in SIDES and player is not None:
                path = "learned" if track.key.endswith("-learned") else "pursuit"
                found[track.side][entry.slug] = {"player": player, "path": path}
    return found


def _player(track: ShownTrack, entry: ShownEntry, policies: Policies, zoo: Zoo) -> str | None:
    plays = entry.row.get("plays")
    if (track.key, entry.slug) in policies:
        return f"agent:{submitted_file(track.key, entry.slug)}"
    if entry.kind == "script" and plays in (*ALLIES, *OPPONENTS):
        return f"script:{plays}"
    return f"agent:{agent_file(plays)}" if entry.kind == "zoo" and plays in zoo else None
