"""Lines without control characters on standard output, the package's log messages, and CSV."""

from __future__ import annotations

import contextlib
import csv
import io
import logging
import math
import re
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator
from importlib import resources
from importlib.metadata import metadata
from pathlib import Path
from typing import TextIO

from fpg_bench.common.errors import printable

LINE_EVERY_S = 30.0  # between two lines of progress without a terminal
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


def page(name: str) -> str:
    """Return where a page is: its address, else its file on this machine, else its file in the source.

    Args:
        name: folder and name without suffix, such as ``guides/datasets``.
    """
    if address := published().get("Documentation"):
        return f"{address.rstrip('/')}/{name}.html"
    file = docs_folder() / f"{name}.md"
    return str(file) if file.is_file() else f"docs/{name}.md of the source of fpg-bench"


def published() -> dict[str, str]:
    """Return the addresses of ``[project.urls]`` by label, as the package's metadata holds them."""
    lines = metadata("fpg-bench").get_all("Project-URL") or []
    return dict(line.split(", ", 1) for line in lines)


def docs_folder() -> Path:
    """Return the folder of the documentation: some pages in an installed package, all in the repository."""
    package = Path(str(resources.files("fpg_bench")))
    installed = package / "docs"
    return installed if installed.is_dir() else package.parent / "docs"


@contextlib.contextmanager
def shown_progress(draws: bool = True) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows what is under way, and how much of it is done: ``show(what, done, total)``.

    On a terminal it draws a bar with count, share and time left; elsewhere it prints a line each half minute.

    Args:
        draws: False prints lines on a terminal, too, as one of several processes.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.table import Column

    last_line = time.monotonic()
    columns = (
        TextColumn("{task.description}", markup=False, table_column=Column(ratio=1, no_wrap=True)),
        BarColumn(bar_width=16),
        MofNCompleteColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    is_hidden = not (draws and is_terminal(sys.stderr))
    with Progress(*columns, console=console, transient=True, expand=True, disable=is_hidden) as bar:
        task = bar.add_task("", total=None)

        def show(what: str, done: int, total: int) -> None:
            nonlocal last_line
            bar.update(task, description=printable(what), completed=done, total=total)
            if bar.disable and time.monotonic() - last_line >= LINE_EVERY_S:
                last_line = time.monotonic()
                if sys.stderr is not None:
                    print(printable(f"{what}: {done:,} of {total:,}"), file=sys.stderr, flush=True)

        yield show
