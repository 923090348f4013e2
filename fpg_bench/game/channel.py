"""Measured or traced channels: the gain from base station to ally on a regular grid, from a CSV file."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded

COLUMNS = ("x", "y", "z", "gain_db")
_MOST_BYTES = 100_000_000
_TOLERANCE = 1e-6  # of a spacing


class Channel(NamedTuple):
    """Gains on a regular grid, as the kernel reads them.

    Attributes:
        gain_db: ``(nx, ny, nz)``, of the path from base station to ally.
        origin_m: ``(3,)``, place of the first gain.
        per_spacing: ``(3,)``, 1 / distance of neighbours in m.
    """

    gain_db: np.ndarray
    origin_m: np.ndarray
    per_spacing: np.ndarray

    @property
    def end_m(self) -> np.ndarray:
        """Place of the last gain, ``(3,)``."""
        last: np.ndarray = self.origin_m + (np.array(self.gain_db.shape) - 1) / self.per_spacing
        return last

    @property
    def hash(self) -> str:
        """SHA-256 of the numbers, 64 hexadecimal digits."""
        digest = hashlib.sha256(repr(self.gain_db.shape).encode())
        for part in self:
            digest.update(np.ascontiguousarray(part, "<f8").tobytes())
        return digest.hexdigest()


def load_channel(path: str | Path) -> Channel:
    """Load a channel: columns x, y, z in m and gain_db, a row for each place of a regular grid, in any order.

    Raises:
        UserError: the file cannot be read, or its first bad line: no number, a gain above 0 dB, a place
            that comes twice; or the grid has holes or unequal spacings.
    """
    where = f"channel {path}"
    text = read_bounded(Path(path), "channel", _MOST_BYTES).decode("utf-8", "replace")
    lines = csv.reader(io.StringIO(text))
    head = next(lines, [])
    if tuple(word.strip() for word in head) != COLUMNS:
        raise UserError(
            f"{where}: line 1: expected the columns {','.join(COLUMNS)}, got {','.join(head)!r:.60}"
        )
    gains: dict[tuple[float, ...], float] = {}
    for line in lines:
        if line:
            *place, gain = _numbers(line, f"{where}: line {lines.line_num}")
            if gain > 0:
                number = f"line {lines.line_num}: gain_db {gain:g}"
                raise UserError(f"{where}: {number}: at most 0 dB; write a path loss with a minus")
            if gains.setdefault(tuple(place), gain) is not gain:
                raise UserError(f"{where}: line {lines.line_num}: {place} comes twice")
    axes = [sorted({place[axis] for place in gains}) for axis in range(3)]
    for name, axis in zip(COLUMNS, axes, strict=False):
        if len(axis) < 2:
            raise UserError(f"{where}: {name}: expected 2 places or more, got {len(axis)}")
        steps = np.diff(axis)
        if np.ptp(steps) > _TOLERANCE * steps.mean():
            raise UserError(f"{where}: {name}: unequal spacings, {steps.min():g} to {steps.max():g} m")
    full = [(x, y, z) for x in axes[0] for y in axes[1] for z in axes[2]]
    if hole := next((place for place in full if place not in gains), None):
        raise UserError(f"{where}: no gain at {hole}: a grid has a row for each of its {len(full):,} places")
    shape = tuple(map(len, axes))
    return Channel(
        np.array([gains[place] for place in full]).reshape(shape),
        np.array([axis[0] for axis in axes]),
        np.array([(len(axis) - 1) / (axis[-1] - axis[0]) for axis in axes]),
    )


def _numbers(line: list[str], where: str) -> list[float]:
    try:
        numbers = [float(word) for word in line]
    except ValueError:
        raise UserError(f"{where}: expected four numbers, got {','.join(line)!r:.60}") from None
    if len(numbers) != len(COLUMNS) or not all(map(math.isfinite, numbers)):
        raise UserError(f"{where}: expected four finite numbers, got {','.join(line)!r:.60}")
    return numbers
