"""The one lock of all that writes: on a file, or on a folder by the file that describes its content."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import filelock

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_own_folder


@contextlib.contextmanager
def locked(path: Path, what: object = None) -> Iterator[None]:
    """Hold a file, which need not exist, until this process lets go of it or dies.

    The parts of a process share it: a match and its planner write the same transcript. The lock is a hidden
    file beside it, which is removed at the end, and so are new folders that stay empty.

    Args:
        path: the file.
        what: what it stands for in messages; None: the file itself.

    Raises:
        UserError: another process holds it.
    """
    if path.is_char_device():  # such as /dev/null
        yield
        return
    target = path.resolve()
    made = [folder for folder in target.parents if not folder.exists()]
    target.parent.mkdir(parents=True, exist_ok=True)
    file = target.with_name(f".{target.name}.lock")
    lock = filelock.FileLock(file, thread_local=False, is_singleton=True)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout as error:
        raise UserError(f"{what or path}: another process is writing there; wait until it ends") from error
    except OSError as error:  # in a folder of somebody else's
        error.filename = str(path)
        raise
    try:
        yield
    finally:
        if lock.lock_counter == 1:
            with contextlib.suppress(OSError):  # Windows removes it once it is closed
                file.unlink()
        lock.release()
        with contextlib.suppress(OSError):  # they hold something
            for folder in made:
                folder.rmdir()


@contextlib.contextmanager
def own_folder(folder: Path, description: str, what: str) -> Iterator[None]:
    """Hold a folder that is empty, or whose content is described by a file of this name.

    Args:
        folder, description, what: as for :func:`fpg_bench.common.files.check_own_folder`.

    Raises:
        UserError: the folder holds something else, or another process is writing there.
    """
    check_own_folder(folder, description, what)
    with locked(folder / description, folder):
        yield
