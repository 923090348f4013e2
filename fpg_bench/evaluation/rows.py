"""Rows: one JSON line per round played, only ever appended, so that nothing computed is lost."""

from __future__ import annotations

import contextlib
import fcntl
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError

Row = dict[str, Any]


class RowFile:
    """An append-only file of rows. A last line that was cut off while it was written is dropped.

    Args:
        path: the file; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> list[Row]:
        """All whole rows.

        Raises:
            UserError: the file cannot be read, or a line that is not the last is not a row.
        """
        return [row for row, _ in self._lines()]

    def append(self, rows: Iterable[Row]) -> None:
        """Add rows in one write and flush them; a torn last line is cut off first."""
        text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._cut_torn_line()
        with self.path.open("a", encoding="utf-8") as file:
            file.write(text)

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the file for this process alone.

        Raises:
            UserError: another process holds it.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise UserError(f"rows {self.path}: another process is writing them") from error
            yield

    def _lines(self) -> Iterator[tuple[Row, int]]:
        """Each whole row and where its line ends in the file."""
        try:
            data = self.path.read_bytes() if self.path.exists() else b""
        except OSError as error:
            raise UserError(f"rows {self.path}: cannot be read: {error.strerror}") from error
        end = 0
        for number, line in enumerate(data.splitlines(keepends=True), 1):
            end += len(line)
            if not line.endswith(b"\n"):
                return  # torn: the run that wrote it was stopped
            try:
                row = json.loads(line)
            except ValueError as error:
                raise UserError(f"rows {self.path}: line {number} is no row: {error}") from error
            if not isinstance(row, dict):
                raise UserError(f"rows {self.path}: line {number} is no row: {row!r}")
            yield row, end

    def _cut_torn_line(self) -> None:
        if not self.path.exists():
            return
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            with self.path.open("r+b") as file:
                file.truncate(whole)
