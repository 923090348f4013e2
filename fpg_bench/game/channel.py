"""Measured or traced channels: the gain from base station to ally on a regular grid, from a CSV file."""

from __future__ import annotations

import hashlib
import io
import math
from array import array
from itertools import product, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded

COLUMNS = ("x", "y", "z", "gain_db")
_MOST_BYTES = 40_000_000
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
    held = io.BytesIO(read_bounded(Path(path), "channel", _MOST_BYTES))
    lines = enumerate(io.TextIOWrapper(held, "utf-8", "replace"), 1)
    _, head = next(lines, (1, ""))
    if tuple(map(str.strip, head.split(","))) != COLUMNS:
        raise UserError(
            f"{where}: line 1: expected the columns {','.join(COLUMNS)}, got {head.strip()!r:.60}"
        )
    numbers, line_of = array("d"), array("L")
    for number, line in lines:
        if line.strip():
            numbers.extend(_numbers(line, f"{where}: line {number}"))
            line_of.append(number)
    rows = np.array(numbers).reshape(-1, len(COLUMNS))
    order = np.lexsort(rows[:, 2::-1].T)
    places, gains = rows[order, :3], rows[order, 3]
    if (again := order[1:][(places[1:] == places[:-1]).all(axis=1)]).size:
        first = again.min()
        raise UserError(f"{where}: line {line_of[first]}: {rows[first, :3].tolist()} comes twice")
    axes = [np.unique(axis) for axis in places.T]
    for name, axis in zip(COLUMNS, axes, strict=False):
        if len(axis) < 2:
            raise UserError(f"{where}: {name}: expected 2 places or more, got {len(axis)}")
        steps = np.diff(axis)
        if np.ptp(steps) > _TOLERANCE * steps.mean():
            raise UserError(f"{where}: {name}: unequal spacings, {steps.min():g} to {steps.max():g} m")
    shape = tuple(map(len, axes))
    if math.prod(shape) > len(places):  # the grid is made of what is held alone
        full = product(*(axis.tolist() for axis in axes))
        hole = next(wanted for wanted, place in zip_longest(full, map(tuple, places)) if wanted != place)
        raise UserError(
            f"{where}: no gain at {hole}: a grid has a row for each of its {math.prod(shape):,} places"
        )
    return Channel(
        gains.reshape(shape),
        np.array([axis[0] for axis in axes]),
        np.array([(len(axis) - 1) / (axis[-1] - axis[0]) for axis in axes]),
    )


def _numbers(line: str, where: str) -> list[float]:
    try:
        numbers = [float(word) for word in line.split(",")]
    except ValueError:
        raise UserError(f"{where}: expected four numbers, got {line.strip()!r:.60}") from None
    if len(numbers) != len(COLUMNS) or not all(map(math.isfinite, numbers)):
        raise UserError(f"{where}: expected four finite numbers, got {line.strip()!r:.60}")
    if numbers[3] > 0:
        raise UserError(f"{where}: gain_db {numbers[3]:g}: at most 0 dB; write a path loss with a minus")
    return numbers
