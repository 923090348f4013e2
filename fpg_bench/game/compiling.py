"""Numba compilation with a disk cache that notices every change of the rules."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy
from numba import config

# Private modules of Numba, used only here: for the notice of compilation, and for the cache's location.
from numba.core import caching, event

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import user_cache

_PACKAGE = Path(__file__).parents[1]
_SOURCES = ("game", "players")
_GAME = _PACKAGE / "game"
_UNUSED_DAYS = 30
if getattr(config, "DISABLE_JIT", False):
    raise UserError("NUMBA_DISABLE_JIT is set, but the game runs as compiled code alone; unset it")


def source_digest(home: Path = _GAME) -> str:
    """Return a digest of the core's compiled sources, of a folder's own, and of the compiler's version."""
    digest = hashlib.sha256(f"{numba.__version__} {numpy.__version__}".encode())
    for folder in dict.fromkeys([*(_PACKAGE / name for name in _SOURCES), home]):
        for path in sorted(folder.glob("*.py")):
            content = path.read_bytes()
            digest.update(f"\0{folder.name}/{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


@functools.cache
def cache_folder(home: Path = _GAME) -> Path | None:
    """Return the cache folder of code compiled from a folder's sources, one per digest of the sources.

    Numba's own cache looks at the file of the compiled function alone and would keep running an
    old version of what that function calls. None where the folder can't be written.
    """
    own_root = getattr(config, "CACHE_DIR", "")  # the environment's NUMBA_CACHE_DIR
    root = Path(own_root) / "fpg_bench" if own_root else user_cache()
    folder = root / f"compiled-{source_digest(home)}"
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
    """Remove the cache folders of older versions that have not been used for a month."""
    for folder in root.glob("compiled-*"):
        with contextlib.suppress(OSError):  # another process may be removing it too
            if time.time() - folder.stat().st_mtime > _UNUSED_DAYS * 24 * 3600:
                shutil.rmtree(folder)


class ByContent(getattr(caching, "UserProvidedCacheLocator", object)):  # type: ignore[misc]
    """Names cached functions by their package folder, wherever the package is installed.

    The digest in the folder's name identifies its content. So a second environment, or a second copy of the
    same sources, compiles nothing. Numba 0.61 has no such option, and compiles anew in each place.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the package folder, such as ``game``; for other files, Numba's own name."""
        path = Path(py_file).resolve()
        if _PACKAGE.resolve() in path.parents:
            return path.parent.name
        return str(super().get_suitable_cache_subpath(py_file))


class _Hashed(caching.IndexDataCacheFile):
    """Numba's files of a cached function, each pickle behind its hash: damaged code ends a process."""

    def _dump(self, content: Any) -> bytes:
        data: bytes = super()._dump(content)  # type: ignore[no-untyped-call]
        return hashlib.sha256(data).digest() + data

    def _load_data(self, name: str) -> Any:
        """Return the content of a file; raises ValueError for a damaged one."""
        data = Path(self._cache_path, name).read_bytes()
        if hashlib.sha256(data[32:]).digest() != data[:32]:
            raise ValueError(f"{name}: damaged")
        return pickle.loads(data[32:])

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._save_data(self._index_name, (self._source_stamp, overloads))  # type: ignore[no-untyped-call]

    def _load_index(self) -> Any:
        try:
            stamp, overloads = self._load_data(self._index_name)
        except FileNotFoundError:
            return {}
        return overloads if stamp == self._source_stamp else {}


class _Cache(caching.FunctionCache):
    """Numba's cache of a function, in which a damaged file is a miss: it is compiled and written anew."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        files = self._cache_file
        self._cache_file = _Hashed(  # type: ignore[no-untyped-call]
            self._cache_path, self._impl.filename_base, files._source_stamp
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code of a signature; None if there is none, or none that can be read."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # whatever a damaged pickle raises
            with contextlib.suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature; on a full disk it is played with and not kept."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


def compiled(function: Callable[..., Any], allocates: bool = False) -> Any:
    """Compile a function: no fast-math (identical bits), no GIL, cached on disk.

    All of a step of the game is put into one piece of machine code, without wrappers for C, which nobody
    calls, and without Numba's reference counts (``_nrt``): the game allocates nothing, and counting took more
    time than some of its equations.

    Args:
        function: the function.
        allocates: true if it makes arrays, or calls a function that does.
    """
    folder = cache_folder(Path(function.__code__.co_filename).parent)
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    options |= {"_nrt": allocates, "forceinline": not allocates}
    with _cached_in(folder):
        dispatcher = numba.njit(**options)(function)
        if folder is not None:
            dispatcher._cache = _Cache(function)
        return dispatcher


@contextlib.contextmanager
def _cached_in(folder: Path | None) -> Iterator[None]:
    """Within the context, let Numba cache functions in this folder."""
    wanted = {"CACHE_DIR": str(folder or ""), "CACHE_LOCATOR_CLASSES": f"{__name__}.{ByContent.__name__}"}
    before = {name: getattr(config, name, "") for name in wanted}
    vars(config).update(wanted)
    try:
        yield
    finally:
        vars(config).update(before)


def _amount(folder: Path | None) -> str:
    """Describe what is to be compiled, with a rough time (9 s on one core for everything)."""
    if folder is not None and any(folder.rglob("*.nbi")):
        return "what is new to the game, a few seconds"
    return "the game, about ten seconds on a free core"


class _Notice(event.Listener):
    """Prints one line on standard error when the game is being compiled."""

    def __init__(self) -> None:
        self.given = False

    def on_start(self, started: event.Event) -> None:
        """Called when a function is not in the cache and is compiled."""
        ours = started.data["dispatcher"].py_func.__module__.startswith("fpg_bench.")
        if ours and not self.given:
            self.given = True
            folder = cache_folder()
            where = "cannot be kept: no writable cache folder" if folder is None else f"kept in {folder}"
            print(f"fpg_bench: compiling {_amount(folder)} ({where})", file=sys.stderr, flush=True)

    def on_end(self, ended: event.Event) -> None:
        """Called when a compilation has ended; does nothing."""


event.register("numba:compile", _Notice())
