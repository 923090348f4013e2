"""Transcripts that somebody else has recorded: packed by gzip or not, and read within bounds."""

from __future__ import annotations

from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import read_object

MOST_BYTES = 16_000_000  # of one transcript, unpacked; that of 20 matches is about 1.4 MB
MOST_LINES = 20_000
LONGEST_LINE = 1_000_000  # bytes


def packed_rows(path: Path) -> list[Row]:
    """All rows of a transcript, which must be whole; no more than ``MOST_BYTES`` of it are ever held.

    Args:
        path: the file; its name ends in ``.gz`` where it is packed.

    Raises:
        UserError: it can't be read or unpacked, is too long, has a line that is too long or no row, or ends
            in the middle of one.
    """
    data = read_bounded(path, "transcript", MOST_BYTES)
    if data.count(b"\n") > MOST_LINES:
        raise UserError(f"transcript {path}: has more than {MOST_LINES:,} lines")
    *lines, rest = data.split(b"\n")
    if rest:
        raise UserError(f"transcript {path}: is cut off in its last line")
    return [_row(line, f"transcript {path}: line {number}") for number, line in enumerate(lines, 1)]


def _row(line: bytes, where: str) -> Row:
    if len(line) > LONGEST_LINE:
        raise UserError(f"{where} is longer than {LONGEST_LINE:,} bytes")
    try:
        return read_object(line)
    except ValueError as error:
        raise UserError(f"{where} is no row: {error}") from error
