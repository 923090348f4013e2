"""Lines without control characters on standard output, the package's log messages, and CSV."""

from __future__ import annotations

import csv
import io
import logging
import math
import re
import sys
import textwrap
from collections.abc import Iterable
from typing import TextIO

from fpg_bench.common.errors import printable

# What begins a spreadsheet's formula, also as a full-width sign; and cells that begin so, but are harmless.
_FORMULA = re.compile(r"\s*[-=+@\uff0d\uff1d\uff0b\uff20]")
_NUMBER = re.compile(r"[-+]?([\d.]+(e[-+]?\d+)?( ± [\d.]+)?( \[[-+\d.e, ]+\])?)?", re.ASCII)


def csv_text(lines: Iterable[Iterable[object]]) -> str:
    """Return lines of cells as CSV; a quote begins text that a spreadsheet would run as a formula.

    >>> csv_text([["=1+2", "-1.5 ± 0.2", -1.5]])
    "'=1+2,-1.5 ± 0.2,-1.5\\n"
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([*map(_plain, line)] for line in lines)
    return text.getvalue()


def _plain(cell: object) -> object:
    is_formula = isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell)
    return f"'{cell}" if is_formula else cell


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
    """Return True for an open terminal; services and ``2>&-`` have no stream, and some streams only write."""
    return stream is not None and not getattr(stream, "closed", True) and stream.isatty()


def accept_all_letters() -> None:
    """Let the standard streams replace letters that the locale's encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if (reconfigure := getattr(stream, "reconfigure", None)) is not None:
            reconfigure(errors="replace")


def number(value: float | None, factor: float = 1, digits: int = 1) -> str:
    """Return a number as text; a dash if there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{round(value * factor, digits) + 0.0:.{digits}f}"  # never -0.0
