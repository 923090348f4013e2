"""Jobs that fill a folder: in place where the worker sees it, else brought back by the driver."""

from __future__ import annotations

import os
import shutil
import tempfile
import uuid
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.common.files import write_whole
from fpg_bench.jobs.job import Job

_MARK = ".shared"

Files = dict[str, bytes]


def mark(folder: Path) -> str:
    """Put a mark into a folder, by which a worker can tell it from one of that name on its own disk."""
    path = folder / _MARK
    if not path.exists():
        write_whole(path, uuid.uuid4().hex)
    return path.read_text()


def sees(folder: Path, marked: str) -> bool:
    """Whether this process sees the folder that was marked."""
    try:
        return (folder / _MARK).read_text() == marked
    except OSError:
        return False


def folder_job(name: str, folder: Path, run: Callable[[Path], Any], done: Callable[[], bool]) -> Job:
    """A job that fills a folder; what it returns is dropped.

    Args:
        name: what lines call it.
        folder: where its files shall lie.
        run: told the folder to fill, which is a temporary one where the worker does not see ``folder``.
        done: whether all files are there.
    """
    folder = folder.absolute()
    return Job(name, partial(_fill, run, folder, mark(folder.parent)), partial(_keep, folder), done)


def _fill(run: Callable[[Path], Any], folder: Path, marked: str) -> Files | None:
    """Fill the folder, in a worker; gives the files if they have to travel."""
    if sees(folder.parent, marked):
        run(folder)
        return None
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / folder.name
        run(made)
        files = (path for path in made.rglob("*") if path.is_file())
        return {str(path.relative_to(made)): path.read_bytes() for path in files}


def _keep(folder: Path, files: Files | None) -> None:
    """Write the files that came back, all or none of them, in place of what was begun here before."""
    if files is None:
        return
    fresh = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    try:
        for name, content in files.items():
            write_whole(fresh / name, content)
        os.chmod(fresh, 0o755)
        shutil.rmtree(folder, ignore_errors=True)
        fresh.rename(folder)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise
