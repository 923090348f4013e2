"""What of a board is new since a revision: nothing of that is believed, it is played by who verifies."""

from __future__ import annotations

import subprocess
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.leaderboard.crossplay import crossplay_file
from fpg_bench.leaderboard.submission import TRACKS
from fpg_bench.plain_json import read_object
from fpg_bench.rows import Row


def changed_since(board: Path, revision: str) -> set[str]:
    """The entries, ``track/name``, whose submission or result is not as it was at a revision of git.

    Raises:
        UserError: no such revision, or a board that lies in no checkout of git.
    """
    changed = _git(
        board, "diff", "--name-only", "--no-renames", "--relative", "-z", _checked(revision), "--", "."
    )
    new = _git(board, "ls-files", "--others", "-z")
    names = (tuple(path.split("/")) for path in (changed + new).split("\0"))
    return {
        f"{parts[1]}/{parts[2].removesuffix('.jsonl') if parts[0] == 'results' else parts[2]}"
        for parts in names
        if len(parts) > 2 and parts[0] in ("submissions", "results") and parts[1] in TRACKS
    }


def pairs_at(board: Path, revision: str) -> list[Row]:
    """The rows of cross-play at a revision of git; none where there was no such file.

    Raises:
        UserError: no such revision, or a board that lies in no checkout of git.
    """
    _git(board, "rev-parse", "--verify", "--quiet", f"{_checked(revision)}^{{commit}}")
    file = crossplay_file(board).relative_to(board)
    try:
        text = _git(board, "show", f"{revision}:./{file.as_posix()}")
    except UserError:
        return []
    return [read_object(line) for line in text.split("\n") if line]


def _checked(revision: str) -> str:
    if revision.startswith("-"):
        raise UserError(f"since: expected a revision of git, got {revision!r}")
    return revision


def _git(board: Path, *words: str) -> str:
    try:
        found = subprocess.run(["git", "-C", str(board), *words], capture_output=True, check=False)
    except OSError as error:
        raise UserError(f"since: git cannot be run: {error.strerror}") from error
    if found.returncode:
        said = " ".join(found.stderr.decode("utf-8", "replace").split()) or "no such revision"
        raise UserError(f"since: {said}")
    return found.stdout.decode("utf-8", "replace")
