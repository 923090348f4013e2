"""The mark of a folder that holds a site: it may be cleared, and says what the site was made of."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from fpg_bench.common.files import check_own_folder
from fpg_bench.players.agent import baselines_folder
from fpg_bench.version import versions

MARK = ".fpg-site"


def check_folder(folder: Path) -> None:
    """Raise UserError where a folder holds something other than a site."""
    check_own_folder(folder, MARK, "leaderboard's site")


def inputs_of(folder: Path, out: Path, *options: object) -> str:
    """Return a digest of all that a site is made of.

    Args:
        folder: the leaderboard.
        out: the site, which is none of it where it lies within.
        *options: what else its pages depend on.
    """
    home = baselines_folder()
    beside = (home.parent / name for name in ("docs", "results", "leaderboard"))
    return _digest((Path(__file__).parents[3], home, *beside, folder), out, options, versions())


def mark_of(inputs: str, out: Path) -> str:
    """Return the text of the mark of a site as it stands, made of inputs of this digest."""
    return f"made by fpg-bench leaderboard build of {inputs}, as {_digest((out,), out / MARK)}\n"


def _digest(folders: Iterable[Path], but: Path, *also: object) -> str:
    """Return a digest of the files in folders, without those in or at ``but``."""
    digest, but = hashlib.sha256(repr(also).encode()), but.resolve()
    for root in (folder.resolve() for folder in folders):
        for path in sorted(root.rglob("*")):
            if path.is_file() and but not in (path, *path.parents) and "__pycache__" not in path.parts:
                digest.update(f"\0{path.relative_to(root)}\0".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
