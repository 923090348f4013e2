"""Numba with a cache on disk that notices every change of the rules, and says when it compiles."""

from __future__ import annotations

import functools
import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba import config

_PACKAGE = Path(__file__).parents[1]
_SOURCES = ("game", "players")


@functools.cache
def cache_folder() -> Path | None:
    """Where compiled code is kept: one folder per content of the rules and version of Numba.

    Numba's own cache looks at the file of the compiled function alone and would keep running an
    old version of what that function calls. None where the folder can't be written.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for name in _SOURCES:
        for path in sorted((_PACKAGE / name).glob("*.py")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    root = config.CACHE_DIR or platformdirs.user_cache_dir("fpg_bench")
    folder = Path(root) / f"compiled-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def compiled(function: Callable) -> Any:
    """Compile a function of the game: no fast-math (same bits everywhere), no GIL, cached on disk."""
    folder = cache_folder()
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder or "")
    try:
        return numba.njit(cache=folder is not None, nogil=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before


@functools.cache
def announce_compilation() -> None:
    """Say once on standard error that the first use compiles, where nothing is cached yet."""
    folder = cache_folder()
    if folder is None or not any(folder.rglob("*.nbi")):
        where = "it cannot be kept: no writable cache folder" if folder is None else f"kept in {folder}"
        print(
            f"fpg_bench: compiling the game, about half a minute, once ({where})", file=sys.stderr, flush=True
        )
