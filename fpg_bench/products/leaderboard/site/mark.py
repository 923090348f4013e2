"""The mark of a folder that holds a site: it may be cleared, and says what the site was made of."""

from __future__ import annotations

import hashlib
from pathlib import Path

from fpg_bench.common.files import check_own_folder
from fpg_bench.players.agent import baselines_folder
from fpg_bench.version import versions

MARK = ".fpg-site"


def check_folder(folder: Path) -> None:
    """Raise UserError where a folder holds something other than a site."""
    check_own_folder(folder, MARK, "leaderboard's site")


def made_of(folder: Path, out: Path, *options: object) -> str:
    """Return the mark's text: a digest of all that a site is made of, and of its files' names and sizes.

    Args:
        folder: the leaderboard.
        out: the site.
        *options: what else its pages depend on.
    """
    digest, home = hashlib.sha256(repr((options, versions())).encode()), baselines_folder()
    others = (home.parent / name for name in ("docs", "results", "leaderboard"))
    for root in (Path(__file__).parents[3], home, *others, folder, out):
        for path in sorted(root.rglob("*")):
            if path.is_file() and path.name != MARK and "__pycache__" not in path.parts:
                digest.update(f"\0{path.relative_to(root)}\0{path.stat().st_size}\0".encode())
                if root is not out:
                    with path.open("rb") as file:
                        digest.update(hashlib.file_digest(file, "sha256").digest())
    return f"made by fpg-bench leaderboard build of {digest.hexdigest()}\n"
