"""What is not as it was at a revision: nothing of it is believed, it is played by who verifies, or named.

Files are compared by their bytes on the disk with what git keeps of the revision; neither the index nor
attributes, filters or links decide what is looked at.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import read_object
from fpg_bench.leaderboard.pairs import crossplay_file
from fpg_bench.leaderboard.submission import TRACKS

_NO_FILE = "no plain file"


@dataclass(frozen=True)
class Changes:
    """What is other than it was, came, or went.

    Attributes:
        entries: ``track/name`` of those whose submission or result it is.
        others: files that are no entry's and not the pairs', from the top of the checkout, sorted.
    """

    entries: frozenset[str] = frozenset()
    others: tuple[str, ...] = ()


def changed_entries(board: Path, revision: str) -> Changes:
    """What is not as it was at a revision of git.

    Raises:
        UserError: no such revision, or a board that lies in no checkout, in a submodule or behind a link.
    """
    top, commit = _checkout(board), _commit(board, revision)
    before = _kept(top, commit)
    listed = _git(top, "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    now = {path for path in listed.split("\0") if path} | {str(p.relative_to(top)) for p in _there(board)}
    changed = [path for path in sorted(before.keys() | now) if before.get(path) != _blob(top / path, commit)]
    home = board.resolve().relative_to(top)
    names = {path: _entry(Path(path), home) for path in changed}
    pairs = str(crossplay_file(home))
    return Changes(
        frozenset(name for name in names.values() if name is not None),
        tuple(path for path in changed if names[path] is None and path != pairs),
    )


def pairs_at(board: Path, revision: str) -> list[Row]:
    """The rows of cross-play at a revision of git; none where there was no such file.

    Raises:
        UserError: as :func:`changes_since` does.
    """
    top, commit = _checkout(board), _commit(board, revision)
    blob = _kept(top, commit).get(str(crossplay_file(board.resolve().relative_to(top))))
    text = "" if blob is None else _git(top, "cat-file", "blob", blob)
    return [read_object(line) for line in text.split("\n") if line]


def _checkout(board: Path) -> Path:
    """The top of the checkout that a board lies in, with no link and no other repository in between."""
    top = Path(_git(board, "rev-parse", "--show-toplevel").removesuffix("\n")).resolve()
    if _git(board, "rev-parse", "--show-superproject-working-tree").strip():
        raise UserError(f"since: {board} lies in a submodule, whose history is its own; name no such board")
    given = Path(os.path.abspath(board))
    inside = [path for path in (given, *given.parents) if path.resolve().is_relative_to(top)]
    above = [board / name / track for name in ("submissions", "results") for track in ("", *TRACKS)]
    for path in (*(path for path in inside if path.resolve() != top), *above):
        if path.is_symlink():
            raise UserError(f"since: {path} is a link; put the folder itself there")
    if not given.resolve().is_relative_to(top):
        raise UserError(f"since: {board} does not lie in its checkout {top}")
    return top


def _commit(board: Path, revision: str) -> str:
    if revision.startswith("-") or not revision:
        raise UserError(f"since: expected a revision of git, got {revision!r}")
    return _git(board, "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}").strip()


def _kept(top: Path, commit: str) -> dict[str, str]:
    """The hashes of all files of a commit, by path."""
    rows = _git(top, "ls-tree", "-r", "-z", "--full-tree", commit).split("\0")
    return {path: told.split(" ")[2] for told, _, path in (row.partition("\t") for row in rows) if told}


def _there(board: Path) -> Iterator[Path]:
    """All that lies in a board's submissions and results, whatever git is told to overlook."""
    for home in (board.resolve() / "submissions", board.resolve() / "results"):
        for folder, folders, files in os.walk(home):
            links = [name for name in folders if (Path(folder) / name).is_symlink()]
            yield from (Path(folder) / name for name in (*files, *links))


def _blob(file: Path, commit: str) -> str | None:
    """The hash that git gives to a file's bytes; None where nothing is.

    A link, what lies behind one, another repository and whatever else is no plain file have no hash of a
    commit's file, and so are never as they were, nor as nothing was.
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
    """Whose a file of a checkout is; None where it is no entry's of the board."""
    parts = path.relative_to(home).parts if path.is_relative_to(home) else ()
    if len(parts) < 3 or parts[0] not in ("submissions", "results") or parts[1] not in TRACKS:
        return None
    name = parts[2].removesuffix(".jsonl") if parts[0] == "results" else parts[2]
    return None if name.startswith(".") else f"{parts[1]}/{name}"


def _git(folder: Path, *words: str) -> str:
    try:
        found = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, check=False)
    except OSError as error:
        raise UserError(f"since: git cannot be run: {error.strerror}") from error
    if found.returncode:
        said = " ".join(found.stderr.decode("utf-8", "replace").split()) or "no such revision"
        raise UserError(f"since: {said}")
    return os.fsdecode(found.stdout)
