"""Numba with a cache on disk that notices every change of the rules, and says when it compiles."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy
import platformdirs
from numba import config

# Private doors, opened here alone: Numba tells nobody else that it compiles, and names its cache by a place.
from numba.core import caching, event

_PACKAGE = Path(__file__).parents[1]
_SOURCES = ("game", "players", "planning")
_UNUSED_DAYS = 30


def source_digest() -> str:
    """A digest of all that is compiled, and of the versions of Numba and NumPy that it is compiled for."""
    digest = hashlib.sha256(f"{numba.__version__} {numpy.__version__}".encode())
    for name in _SOURCES:
        for path in sorted((_PACKAGE / name).glob("*.py")):
            content = path.read_bytes()
            digest.update(f"\0{name}/{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


@functools.cache
def cache_folder() -> Path | None:
    """Where compiled code is kept: one folder per content of the rules and version of Numba.

    Numba's own cache looks at the file of the compiled function alone and would keep running an
    old version of what that function calls. None where the folder can't be written.
    """
    chosen = getattr(config, "CACHE_DIR", "")  # the environment's NUMBA_CACHE_DIR
    root = Path(chosen) / "fpg_bench" if chosen else platformdirs.user_cache_path("fpg_bench")
    folder = root / f"compiled-{source_digest()}"
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.touch()  # in use today
    except OSError:
        return None
    if new:
        _remove_unused(root)
    return folder if os.access(folder, os.W_OK) else None


def _remove_unused(root: Path) -> None:
    """Remove what older versions have left: each change of the rules begins a new folder."""
    for folder in root.glob("compiled-*"):
        with contextlib.suppress(OSError):  # another process may be removing it too
            if time.time() - folder.stat().st_mtime > _UNUSED_DAYS * 24 * 3600:
                shutil.rmtree(folder)


class ByContent(getattr(caching, "UserProvidedCacheLocator", object)):  # type: ignore[misc]
    """Names a function of this package by its room, wherever the package lies.

    The folder's digest says what is in it already. So a second environment, or a second copy of the same
    sources, compiles nothing. Numba 0.61 can't be told of it, and compiles anew in each place.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """The name of the room: ``game``, for instance; for a file elsewhere, Numba's own name."""
        path = Path(py_file).resolve()
        if path.parent.parent == _PACKAGE.resolve():
            return path.parent.name
        named: str = super().get_suitable_cache_subpath(py_file)
        return named


def compiled(function: Callable) -> Any:
    """Compile a function of the game: no fast-math (same bits everywhere), no GIL, cached on disk.

    All of a step is put into one piece of machine code, without Numba's reference counts (``_nrt``):
    the game allocates nothing, and counting took more time than some of its equations.
    """
    folder = cache_folder()
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "forceinline": True, "_nrt": False}
    with _cached_in(folder):
        return numba.njit(cache=folder is not None, **options)(function)


@contextlib.contextmanager
def _cached_in(folder: Path | None) -> Iterator[None]:
    """Have Numba keep what is declared inside in this folder; its settings are then as they were."""
    wanted = {"CACHE_DIR": str(folder or ""), "CACHE_LOCATOR_CLASSES": f"{__name__}.{ByContent.__name__}"}
    before = {name: getattr(config, name, "") for name in wanted}
    vars(config).update(wanted)
    try:
        yield
    finally:
        vars(config).update(before)


def _amount(folder: Path | None) -> str:
    """How much is to be compiled, and about how long that takes: all of it took 9 s of a core of 2026."""
    if folder is not None and any(folder.rglob("*.nbi")):
        return "what is new to the game, a few seconds"
    return "the game, about ten seconds on a free core"


class _Notice(event.Listener):
    """Says once on standard error that the game is being compiled, when it is."""

    def __init__(self) -> None:
        self.given = False

    def on_start(self, started: event.Event) -> None:
        """A function is not in the cache, and begins to be compiled."""
        ours = started.data["dispatcher"].py_func.__module__.startswith("fpg_bench.")
        if ours and not self.given:
            self.given = True
            folder = cache_folder()
            where = "cannot be kept: no writable cache folder" if folder is None else f"kept in {folder}"
            print(f"fpg_bench: compiling {_amount(folder)} ({where})", file=sys.stderr, flush=True)

    def on_end(self, ended: event.Event) -> None:
        """Nothing to say."""


event.register("numba:compile", _Notice())
