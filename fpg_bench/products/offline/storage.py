"""Files of a data set: HDF5 in Minari's layout, one group per round, in parts that are written whole.

Minari opens ``main_data.hdf5``, which has a link for each round to the part that holds it. So parts are
written by several processes at once, and the finished ones of a run that was killed stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5p, h5s, h5t

from fpg_bench.common.files import check_regular, write_whole
from fpg_bench.products.offline.rounds import Rounds

MAIN = "main_data.hdf5"
BYTES_PER_STEP = 113  # with continuous actions
_DIGESTS = "sha256"  # of each round of a part


def part_path(folder: Path, part: int) -> Path:
    """Return the file of a part."""
    return folder / f"part_{part:05}.hdf5"


def write_part(path: Path, first: int, rounds: Rounds) -> None:
    """Write rounds into a part, atomically.

    A round has five arrays and five attributes, which HDF5's own interface writes twice as fast as h5py's.
    Terminations and truncations are the same in all rounds, and stored once.

    Args:
        path: the file.
        first: number of the first of these rounds.
        rounds: the rounds.

    Raises:
        OSError: the file cannot be written.
    """
    steps = rounds.rewards.shape[1]
    shared = {b"terminations": np.zeros(steps, bool), b"truncations": np.arange(steps) == steps - 1}
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        file[_DIGESTS] = np.frombuffer(b"".join(rounds.digests()), np.uint8).reshape(-1, 32)
        first_group = None
        for k in range(len(rounds)):
            group = h5g.create(file.id, f"episode_{first + k}".encode())
            for name, value in ((b"id", first + k), (b"seed", rounds.seeds[k]), (b"total_steps", steps)):
                h5a.create(group, name, h5t.NATIVE_INT64, _SCALAR).write(np.array(value, np.int64))
            for name, word in ((b"player", rounds.players[k]), (b"rival", rounds.rivals[k])):
                h5a.create(group, name, _TEXT, _SCALAR).write(np.array(word, object))
            _write(group, b"observations", rounds.observations[k])
            _write(group, b"actions", rounds.actions[k])
            _write(group, b"rewards", rounds.rewards[k])
            for name, array in shared.items():
                if first_group is None:
                    _write(group, name, array)
                else:
                    group.links.create_hard(name, first_group, name)
            first_group = first_group or group
        file.flush()
        image = file.id.get_file_image()
    write_whole(path, image)


def part_digests(path: Path) -> bytes:
    """Return the concatenated SHA-256 hashes of a part's rounds; raises OSError for a damaged file."""
    check_regular(path)
    with h5py.File(path) as file:
        return bytes(file[_DIGESTS][()].tobytes())


def link_parts(folder: Path, sizes: Sequence[int]) -> None:
    """Write the main file, which links the rounds of all parts.

    Args:
        folder: the folder of the parts.
        sizes: number of rounds of each part.

    Raises:
        OSError: the file cannot be written.
    """
    with h5py.File(MAIN, "w", driver="core", backing_store=False) as file:
        first = 0
        for part, size in enumerate(sizes):
            for name in (f"episode_{first + k}" for k in range(size)):
                file[name] = h5py.ExternalLink(part_path(folder, part).name, f"/{name}")
            first += size
        file.flush()
        image = file.id.get_file_image()
    write_whole(folder / MAIN, image)


def _creation() -> h5p.PropDCID:
    """Return properties of arrays that are written once, without time stamps, which no rerun would repeat."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_fill_time(h5d.FILL_TIME_NEVER)
    properties.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    properties.set_obj_track_times(False)
    return properties


_SCALAR = h5s.create(h5s.SCALAR)
_TEXT = h5t.py_create(h5py.string_dtype(), logical=True)
_CREATION = _creation()


def _write(group: h5g.GroupID, name: bytes, array: np.ndarray) -> None:
    space = h5s.create_simple(array.shape)
    h5d.create(group, name, h5t.py_create(array.dtype), space, _CREATION).write(h5s.ALL, h5s.ALL, array)
