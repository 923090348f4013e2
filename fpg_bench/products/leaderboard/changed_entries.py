"""Changes since a trusted git revision: changed entries are played again, other changed files are named.

The bytes on the disk are compared with the blobs of the revision. The index, attributes, filters and links do
not influence which files are compared.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import read_object
from fpg_bench.products.leaderboard.folders import (
    ANSWERED,
    RESPONSE_ABOUT,
    TRACK_FOLDERS,
    crossplay_file,
    exploited_file,
)
from fpg_bench.products.sandbox.client import AGENT_FILES

_KINDS = ("submissions", "results", "responses")  # folders of a board
_RESPONSE = (*AGENT_FILES, RESPONSE_ABOUT)
_NO_FILE = "not a regular file"


@dataclass(frozen=True)
class Changes:
    """Files that were changed, added or removed.

    Attributes:
        entries: ``track/name`` of the entries whose submission or result changed.
        others: all other files, relative to the top of the checkout, sorted; but for the file of cross-play,
            responses to entries and their results, whose trusted rows :func:`rows_at` returns.
    """

    entries: frozenset[str] = frozenset()
    others: tuple[str, ...] = ()


def changed_entries(board: Path, revision: str) -> Changes:
    """Return the changes since a git revision.

    Raises:
        UserError: no such revision, or a board outside of any checkout, in a submodule or behind a link.
    """
    top, commit = _checkout(board), _commit(board, revision)
    before = _kept(top, commit)
    listed = _git(top, "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    now = {path for path in listed.split("\0") if path} | {str(p.relative_to(top)) for p in _there(board)}
    changed = [path for path in sorted(before.keys() | now) if before.get(path) != _blob(top / path, commit)]
    home = board.resolve().relative_to(top)
    names = {path: _entry(Path(path), home) for path in changed}
    pairs, responses = str(crossplay_file(home)), str(exploited_file(home))
    credits = {path for path in before if path.endswith(f"/{RESPONSE_ABOUT}")}  # who made what stays so
    return Changes(
        frozenset(name for name in names.values() if name is not None),
        tuple(
            path
            for path in changed
            if names[path] is None
            and path not in (pairs, responses)
            and not (_is_response(Path(path), home) and path not in credits)
        ),
    )


def rows_at(board: Path, revision: str, file: Callable[[Path], Path]) -> list[Row]:
    """Return the rows of a file of a board at a git revision; none if there was no such file.

    Args:
        board: the leaderboard's folder.
        revision: the revision.
        file: returns the file's path by that of the board.

    Raises:
        UserError: as :func:`changed_entries` does.
    """
    top, commit = _checkout(board), _commit(board, revision)
    blob = _kept(top, commit).get(str(file(board.resolve().relative_to(top))))
    text = "" if blob is None else _git(top, "cat-file", "blob", blob)
    return [read_object(line) for line in text.split("\n") if line]


def _checkout(board: Path) -> Path:
    """Return the top of the checkout that contains a board, without links or submodules in between."""
    top = Path(_git(board, "rev-parse", "--show-toplevel").removesuffix("\n")).resolve()
    if _git(board, "rev-parse", "--show-superproject-working-tree").strip():
        raise UserError(f"since: {board} is in a submodule; name a board in a checkout of its own")
    given = Path(os.path.abspath(board))
    inside = [path for path in (given, *given.parents) if path.resolve().is_relative_to(top)]
    above = [board / name / track for name in _KINDS for track in ("", *TRACK_FOLDERS)]
    for path in (*(path for path in inside if path.resolve() != top), *above):
        if path.is_symlink():
            raise UserError(f"since: {path} is a link; put the folder itself there")
    if not given.resolve().is_relative_to(top):
        raise UserError(f"since: {board} is not inside its checkout {top}")
    return top


def _commit(board: Path, revision: str) -> str:
    if revision.startswith("-") or not revision:
        raise UserError(f"since: expected a revision of git, got {revision!r}")
    return _git(board, "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}").strip()


def _kept(top: Path, commit: str) -> dict[str, str]:
    """Return the hashes of all files of a commit, by path."""
    rows = _git(top, "ls-tree", "-r", "-z", "--full-tree", commit).split("\0")
    return {path: meta.split(" ")[2] for meta, _, path in (row.partition("\t") for row in rows) if meta}


def _there(board: Path) -> Iterator[Path]:
    """Yield all files of a board's entries and of responses to them, whatever git is told to ignore."""
    for home in (board.resolve() / name for name in _KINDS):
        for folder, folders, files in os.walk(home):
            links = [name for name in folders if (Path(folder) / name).is_symlink()]
            yield from (Path(folder) / name for name in (*files, *links))


def _blob(file: Path, commit: str) -> str | None:
    """Return git's hash of a file's bytes; None if there is nothing.

    Links, files behind links, other repositories and everything else that is not a regular file get a value
    that equals no hash and not None, so they always count as changed.
    """
    try:
        if not os.path.lexists(file):
            return None
        if file.is_symlink() or not file.is_file() or file.parent.resolve() != file.parent:
            return _NO_FILE
        content = file.read_bytes()
    except OSError:
        return _NO_FILE
    kind = "sha1" if len(commit) == 40 else "sha256"
    return hashlib.new(kind, b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _entry(path: Path, home: Path) -> str | None:
    """Return the entry that a file of a checkout belongs to, ``track/name``; None if there is none."""
    parts = path.relative_to(home).parts if path.is_relative_to(home) else ()
    if len(parts) < 3 or parts[0] not in ("submissions", "results") or parts[1] not in TRACK_FOLDERS:
        return None
    name = parts[2].removesuffix(".jsonl") if parts[0] == "results" else parts[2]
    return None if name.startswith(".") else f"{parts[1]}/{name}"


def _is_response(path: Path, home: Path) -> bool:
    """Return True if a file of a checkout is part of a response to an ally."""
    parts = path.relative_to(home).parts if path.is_relative_to(home) else ()
    return len(parts) == 5 and parts[0] == "responses" and parts[1] == ANSWERED and parts[4] in _RESPONSE


def _git(folder: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, check=False)
    except OSError as error:
        raise UserError(f"since: git cannot be run: {error.strerror}") from error
    if done.returncode:
        message = " ".join(done.stderr.decode("utf-8", "replace").split()) or "no such revision"
        raise UserError(f"since: {message}")
    return os.fsdecode(done.stdout)
