"""The user's cache folder."""

from __future__ import annotations

import functools
import logging
import os
import tempfile
from pathlib import Path

import platformdirs


def user_cache() -> Path:
    """Return the user's cache folder; without a home folder, a private one among the temporary files."""
    try:
        folder = platformdirs.user_cache_path("fpg_bench")
        if folder.is_absolute():
            return folder
    except RuntimeError:  # no HOME, and no entry in the password file
        pass
    return _own_temporary_folder()


@functools.cache
def _own_temporary_folder() -> Path:
    """Return a folder that no other user can write, and say so once: what lies in a cache is run."""
    folder = _made_temporary_folder()
    logging.getLogger(__name__).warning(f"no home folder (set HOME); the cache is {folder}")
    return folder


def _made_temporary_folder() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else ""
    folder = Path(tempfile.gettempdir()) / f"fpg_bench-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
        if user == "" or (about.st_uid == user and about.st_mode & 0o170077 == 0o040000):
            return folder
    except OSError:  # a file, or another's
        pass
    return Path(tempfile.mkdtemp(prefix="fpg_bench-"))
