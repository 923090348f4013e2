"""Looking at somebody's folder: plain files of bounded sizes in plain folders, and nothing that leads out."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from fpg_bench.common.errors import nearest

_MOST_NAMES = 200


def folder_problem(path: Path) -> str | None:
    """Why a path is no plain folder, None where it is one."""
    mode = _mode(path)
    if mode is None:
        return "is not there"
    if stat.S_ISLNK(mode):
        return "is a link; put the folder itself there"
    return None if stat.S_ISDIR(mode) else "is no folder"


def file_problem(path: Path, most_bytes: int) -> str | None:
    """Why a path is no plain file of at most so many bytes, None where it is one."""
    mode = _mode(path)
    if mode is None:
        return "is missing"
    if stat.S_ISLNK(mode):
        return "is a link; put the file itself there"
    if not stat.S_ISREG(mode):
        return "is no plain file"
    size = path.lstat().st_size
    if size > most_bytes:
        return f"holds {size:,} bytes, at most {most_bytes:,} are allowed"
    return None


def names(folder: Path) -> list[str]:
    """The names in a folder, sorted; a few hundred at most."""
    with os.scandir(folder) as entries:
        return sorted(entry.name for entry in islice(entries, _MOST_NAMES))


def strays(folder: Path, known: Iterable[str]) -> list[str]:
    """One line per name in a folder that is not known."""
    known = list(known)
    return [
        f"{shown(name)}: is no file of a submission{nearest(name, known)}"
        for name in names(folder)
        if name not in known
    ]


def brief(path: Path) -> str:
    """A path as a message says it: from the working folder where it lies in there."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def shown(text: object, most: int = 60) -> str:
    """Somebody's word or value as one short line may show it."""
    try:
        word = repr(text)
    except ValueError:  # a whole number of thousands of digits
        word = f"a {type(text).__name__}"
    return word if len(word) <= most else f"{word[: most - 4]}...{word[-1]}"


def _mode(path: Path) -> int | None:
    try:
        return path.lstat().st_mode
    except (OSError, ValueError):  # a name with a null byte
        return None
