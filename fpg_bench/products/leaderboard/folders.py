"""Folders of a leaderboard: their paths, and checks that untrusted folders contain regular files only."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import stat
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path

from fpg_bench.common.errors import UserError, nearest, shown
from fpg_bench.common.files import folder_beside, user_cache, write_whole
from fpg_bench.common.locks import locked
from fpg_bench.players.agent import baselines_folder

TRACK_FOLDERS = ("ally", "opponent", "planner")  # folders of submissions; opponents have two tables
ANSWERED = "ally"  # the track with responses: those to an opponent leave it what pursuit pays anyway
RESPONSE_ABOUT = "response.yaml"
_KEPT = ("submissions", "results", "responses")  # of a board that another one begins with
_MOST_NAMES = 200


def repository_board() -> Path:
    """Return the folder of the benchmark's own board.

    Raises:
        UserError: the package was installed without it.
    """
    board = baselines_folder().parent / "leaderboard"
    if not (board / "submissions").is_dir():
        raise UserError(
            "with-baselines: the benchmark's board is in its repository; run this in a clone of it"
        )
    return board


def start_board(board: Path, source: Path | None = None) -> None:
    """Create the folders of a leaderboard.

    Args:
        board: the new leaderboard.
        source: a leaderboard whose entries, results and responses it begins with; None: it has none.

    Raises:
        UserError: something is in the folder already.
    """
    with at_work(board):
        if not board.is_dir() and board.exists():
            raise UserError(f"leaderboard {board}: is a file; name a folder")
        if board.is_dir() and any(board.iterdir()):
            raise UserError(f"leaderboard {board}: holds files already; name an empty or a new folder")
        with folder_beside(board.absolute()) as temporary:
            for track in TRACK_FOLDERS:
                for kind in _KEPT[:2]:
                    write_whole(temporary / kind / track / ".gitkeep", "")  # git keeps no empty folders
            files = [] if source is None else (f for kind in _KEPT for f in (source / kind).rglob("*"))
            for file in filter(Path.is_file, files):
                write_whole(temporary / os.path.relpath(file, source), file.read_bytes())
            board.mkdir(exist_ok=True)
            for folder in temporary.iterdir():
                os.replace(folder, board / folder.name)


def submission_folders(board: Path, names: Sequence[str] = ()) -> list[Path]:
    """Return the folders of a board's submissions, sorted by track and name.

    Args:
        board: the leaderboard's folder.
        names: ``track/name`` each; empty: all.

    Raises:
        UserError: no board there, or no submission of that name.
    """
    root = board / "submissions"
    if not root.is_dir():
        raise UserError(
            f"leaderboard {board}: has no folder submissions; fpg-bench leaderboard init {board} starts one"
        )
    folders = {
        f"{track}/{folder.name}": folder
        for track in TRACK_FOLDERS
        for folder in sorted((root / track).glob("*"))
        if not folder.name.startswith(".")
    }
    for name in names:
        if name not in folders:
            elsewhere = [other for other in folders if other.partition("/")[2] == name.partition("/")[2]]
            hint = f"; did you mean {elsewhere[0]!r}?" if elsewhere else nearest(name, folders)
            raise UserError(f"no submission {name!r} in {root}{hint}")
    return [folders[name] for name in (sorted(set(names)) or folders)]


def result_file(board: Path, track: str, slug: str) -> Path:
    """Return the path of a submission's result."""
    return board / "results" / track / f"{slug}.jsonl"


def crossplay_file(board: Path) -> Path:
    """Return the path of the results of cross-play."""
    return board / "results" / "crossplay.jsonl"


def exploited_file(board: Path) -> Path:
    """Return the path of the results of responses to entries."""
    return board / "results" / "exploited.jsonl"


def response_folders(board: Path, entry: str) -> list[Path]:
    """Return the folders of the responses to an entry, ``track/name``, sorted; the first few hundred only."""
    home = board / "responses" / entry
    return [home / name for name in list_names(home) if not name.startswith(".")] if home.is_dir() else []


def work_folder(board: Path) -> Path:
    """Return a folder for unfinished work, outside the repository, where no submission can put files."""
    checkout = hashlib.sha256(str(board.resolve()).encode()).hexdigest()[:12]
    return user_cache() / "leaderboard" / checkout


def at_work(board: Path) -> contextlib.AbstractContextManager[None]:
    """Hold a board for this process; raises UserError while another one writes there."""
    return locked(work_folder(board) / "at-work", f"leaderboard {board}")


def set_aside(board: Path, track: str, slug: str) -> Path:
    """Move an untrusted result off the board, whatever it is; return its new path."""
    path = result_file(board, track, slug)
    aside = result_file(work_folder(board) / "claimed", track, slug)
    if path.is_symlink() or path.exists():
        remove(aside)
        aside.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(path, aside)
    return aside


def remove(path: Path) -> None:
    """Remove a file, link or folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


# Folders from others


def folder_problem(path: Path) -> str | None:
    """Return why a path is not a plain folder; None if it is one."""
    mode = _mode(path)
    if mode is None:
        return "does not exist"
    if stat.S_ISLNK(mode):
        return "is a link; put the folder itself there"
    return None if stat.S_ISDIR(mode) else "is not a folder"


def file_problem(path: Path, most_bytes: int) -> str | None:
    """Return why a path is not a regular file of at most ``most_bytes``; None if it is one."""
    mode = _mode(path)
    if mode is None:
        return "is missing"
    if stat.S_ISLNK(mode):
        return "is a link; put the file itself there"
    if not stat.S_ISREG(mode):
        return "is not a regular file"
    size = path.lstat().st_size
    if size > most_bytes:
        return f"holds {size:,} bytes, at most {most_bytes:,} are allowed"
    return None


def list_names(folder: Path) -> list[str]:
    """Return the names in a folder, sorted; the first few hundred only."""
    with os.scandir(folder) as entries:
        return sorted(entry.name for entry in islice(entries, _MOST_NAMES))


def stray_files(folder: Path, expected: Iterable[str]) -> list[str]:
    """Return one line per name in a folder that is not expected there."""
    expected = list(expected)
    return [
        f"{shown(name)}: is not part of a submission{nearest(name, expected)}"
        for name in list_names(folder)
        if name not in expected
    ]


def short_path(path: Path) -> str:
    """Return a path as text, relative to the working directory if it is inside it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _mode(path: Path) -> int | None:
    try:
        return path.lstat().st_mode
    except (OSError, ValueError):  # a name with a null byte
        return None
