"""Lines without control characters on standard output, and the package's log messages."""

from __future__ import annotations

import logging
import sys

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
        print(printable(self.format(record)), file=stream, flush=True)
