"""Lines without control characters on standard output, the package's log messages, and the user's cache."""

from __future__ import annotations

import functools
import logging
import os
import sys
import tempfile
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

import platformdirs

from fpg_bench.common.errors import printable


def print_line(line: str) -> None:
    """Print a line at once, also into a file, without control characters."""
    print(printable(line), flush=True)


def print_messages() -> None:
    """Print the package's log messages from INFO on, warnings on standard error.

    Nothing is changed if its logger has a handler already.
    """
    package = logging.getLogger("fpg_bench")
    if not package.handlers:
        package.addHandler(_PrintHandler())
        package.setLevel(logging.INFO)


class _PrintHandler(logging.Handler):
    """Handler that prints messages as lines of text."""

    def emit(self, record: logging.LogRecord) -> None:
        stream = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
        if stream is None:  # a service, or closed by the shell; print() would take standard output
            return
        print(printable(self.format(record)), file=stream, flush=True)


def wrapped(heading: str, cells: Iterable[str]) -> str:
    """Return a heading on as many lines as its column's cells, and its longest word, allow."""
    return "\n".join(textwrap.wrap(heading, max(map(len, [*heading.split(), *cells]))))


def is_terminal(stream: TextIO | None) -> bool:
    """Return True for an open terminal; services and ``2>&-`` have no stream at all."""
    return stream is not None and not stream.closed and stream.isatty()


def accept_all_letters() -> None:
    """Let the standard streams replace letters that the locale's encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if (reconfigure := getattr(stream, "reconfigure", None)) is not None:
            reconfigure(errors="replace")


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
