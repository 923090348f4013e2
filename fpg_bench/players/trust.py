"""Policies that this user exported, which play in the user's own process; all others play in a sandbox.

An agent's folder says nothing about its origin that somebody else could not have written, so the hash of each
exported policy is kept in the user's data folder.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import platformdirs


def _folder() -> Path | None:
    """Return the folder of empty files named by hashes; None for a user without a home."""
    try:
        return platformdirs.user_data_path("fpg_bench") / "exported"
    except (OSError, RuntimeError):
        return None


def remember_exported(sha256: str) -> None:
    """Remember that this user exported the policy of a hash; where that cannot be kept, it is forgotten."""
    folder = _folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / sha256).touch()


def is_exported_here(sha256: str) -> bool:
    """Return True if this user exported the policy of a hash on this machine."""
    folder = _folder()
    return folder is not None and (folder / sha256).is_file()
