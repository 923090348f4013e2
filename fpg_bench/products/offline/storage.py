"""Files of a data set: HDF5 in Minari's layout, one group per round, in parts that are written whole.

Minari opens ``main_data.hdf5``, which has a link for each round to the part that holds it. So parts are
written by several processes at once, and the finished ones of a run that was killed stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import h5py
import numpy as np

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

    Terminations and truncations are the same in all rounds, and stored once.

    Args:
        path: the file.
        first: number of the first of these rounds.
        rounds: the rounds.

    Raises:
        OSError: the file cannot be written.
    """
    steps = rounds.rewards.shape[1]
    shared = {"terminations": np.zeros(steps, bool), "truncations": np.arange(steps) == steps - 1}
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        file[_DIGESTS] = np.frombuffer(b"".join(rounds.digests()), np.uint8).reshape(-1, 32)
        for k in range(len(rounds)):
            group = file.create_group(f"episode_{first + k}")
            about = {"id": first + k, "seed": rounds.seeds[k], "total_steps": steps}
            group.attrs.update({name: np.int64(number) for name, number in about.items()})
            group.attrs.update({"player": rounds.players[k], "rival": rounds.rivals[k]})
            for name in ("observations", "actions", "rewards"):
                group[name] = getattr(rounds, name)[k]
            for name, array in shared.items():
                group[name] = array if k == 0 else file[f"episode_{first}"][name]
        file.flush()
        image = file.id.get_file_image()
    write_whole(path, image)


def part_digests(path: Path) -> bytes:
    """Return the concatenated SHA-256 hashes of a part's rounds; raises OSError for a damaged file."""
    check_regular(path)
    with h5py.File(path) as file:
        _check_held(_DIGESTS, file[_DIGESTS])
        return bytes(file[_DIGESTS][()].tobytes())


def check_files(folder: Path, most: int) -> None:
    """Raise OSError for an array that is not held or has more bytes, and for a link out of the folder."""
    paths = sorted(folder.glob("*.hdf5"))
    names = {path.name for path in paths}

    def outside(name: str, link: h5py.HardLink | h5py.SoftLink | h5py.ExternalLink) -> str | None:
        return link.filename if isinstance(link, h5py.ExternalLink) and link.filename not in names else None

    for path in paths:
        with h5py.File(path) as file:
            if (other := file.visititems_links(outside)) is not None:
                raise OSError(f"{path.name} links to {other}, which is no part of it")
            file.visititems(partial(_check_held, most=most))


def _check_held(name: str, found: h5py.Group | h5py.Dataset, most: float = math.inf) -> None:
    """Raise OSError for an array that is not held as :func:`write_part` does, plainly, or is too large."""
    if isinstance(found, h5py.Dataset):
        layout, size = found.id.get_create_plist().get_layout(), found.id.get_storage_size()
        is_plain = layout == h5py.h5d.CONTIGUOUS and not found.external and found.size is not None
        if not is_plain or size != found.nbytes or (size > most and name != _DIGESTS):
            raise OSError(f"{name} declares {found.shape} of {found.dtype}, and does not hold it plainly")


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
