"""Append-only files of JSON rows, so that no computed result is lost."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType, UnionType

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import naming, read_bounded, write_whole
from fpg_bench.common.locks import locked
from fpg_bench.common.strict_json import JsonObject, read_object

Row = JsonObject
SEAL = "sha256"  # key of a row's hash
_LARGEST = 2**28  # bytes; those of a long run are a few million


def _text(rows: Iterable[Row]) -> str:
    return "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)


def sealed(row: Row) -> Row:
    """Return a row with the hash of its content, by which an edit or a damaged byte is found."""
    return row | {SEAL: hashlib.sha256(_text([row]).encode()).hexdigest()[:16]}


def unsealed(row: Row, where: str) -> Row:
    """Return a row without its hash; raises UserError, which begins with ``where``, if they do not fit."""
    content = {key: value for key, value in row.items() if key != SEAL}
    if sealed(content) != row:
        raise UserError(f"{where}: was edited or damaged: it does not fit its hash")
    return content


class RowFile:
    """An append-only file of JSON lines. A partial last line is dropped.

    Args:
        path: the file; it need not exist.
        required: keys that each row must have, with the types of their values.
    """

    def __init__(self, path: Path, required: Mapping[str, type | UnionType] = MappingProxyType({})) -> None:
        self.path = path
        self._required = required

    def read(self, on_invalid: Callable[[str], None] | None = None) -> list[Row]:
        """Return all complete rows.

        Args:
            on_invalid: called with a message for each invalid or partial line, which is skipped; None: raise
                for an invalid one.

        Raises:
            UserError: the file cannot be read, is too large, or holds an invalid line.
        """
        is_there = self.path.exists() and not self.path.is_char_device()  # such as /dev/null
        data = read_bounded(self.path, "rows", _LARGEST) if is_there else b""
        lines = data.splitlines(keepends=True)
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()  # partial: the run that wrote it was stopped
            if on_invalid is not None:
                on_invalid(f"rows {self.path}: line {len(lines) + 1} is cut off; it is skipped")
        rows = []
        for number, line in enumerate(lines, 1):
            try:
                rows.append(self._row(number, line))
            except UserError as error:
                if on_invalid is None:
                    raise
                on_invalid(f"{error}; it is skipped")
        return rows

    def _row(self, number: int, line: bytes) -> Row:
        try:
            row = read_object(line, nan=True)
        except ValueError as error:
            raise UserError(f"rows {self.path}: line {number} is not a valid row: {error}") from error
        for key, kind in self._required.items():
            if not isinstance(row.get(key), kind):
                raise UserError(f"rows {self.path}: line {number}: {key} is missing or has the wrong type")
        return row

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows in one write; a partial last line is removed first.

        Raises:
            OSError: the file cannot be written; the error names it, also where the disk is full.
        """
        text = _text(rows)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._truncate_partial_line()
        with naming(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(text)

    def replace(self, rows: Iterable[Row]) -> None:
        """Replace all rows in one step."""
        write_whole(self.path, _text(rows))

    def locked(self) -> contextlib.AbstractContextManager[None]:
        """Hold the file for this process; raises UserError while another one holds it."""
        return locked(self.path)

    def _truncate_partial_line(self) -> None:
        """Remove a partial last line; of complete files only the last byte is read."""
        if not self.path.exists() or not self.path.stat().st_size:
            return
        with self.path.open("r+b") as file:
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.seek(0)
                file.truncate(file.read().rfind(b"\n") + 1)
