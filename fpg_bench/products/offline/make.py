"""Making of data sets: rounds in parts, by several processes, and Minari's metadata."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import shutil
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import gymnasium
import minari
import numpy as np
from minari.serialization import serialize_space

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import check_own_folder, check_writable, read_json, write_json
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.products.offline.rounds import play_rounds
from fpg_bench.products.offline.spec import NAMESPACE, DatasetSpec
from fpg_bench.products.offline.storage import BYTES_PER_STEP, link_parts, part_digests, part_path, write_part
from fpg_bench.version import __version__

ROUNDS_PER_PART = 512
REFERENCE_ROUNDS = 200
METADATA = "metadata.json"
RECIPE = "fpg_bench"  # key of Minari's metadata for the origin of the data set

Progress = Callable[[int, int], None]  # called with the number of finished rounds and the total


def datasets_root() -> Path:
    """Return the folder in which Minari looks for data sets.

    Raises:
        UserError: this user has no home folder, and no variable names another one.
    """
    if named := os.environ.get("MINARI_DATASETS_PATH"):
        return Path(named)
    try:
        return Path.home() / ".minari" / "datasets"
    except RuntimeError as error:
        raise UserError("data sets: no home folder; set MINARI_DATASETS_PATH, or use --out") from error


def make_dataset(
    spec: DatasetSpec,
    out: str | Path | None = None,
    *,
    workers: Workers | int = 1,
    rounds_per_part: int = ROUNDS_PER_PART,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Make a data set in Minari's format; resume an unfinished one, and keep a finished one.

    It is made in the hidden folder ``.NAME.partial``, which is renamed once it is complete.

    Args:
        spec: the specification, as :func:`fpg_bench.products.offline.spec.load_spec` loads it.
        out: a folder of data sets; ``minari.load_dataset`` finds them if ``MINARI_DATASETS_PATH`` is that
            folder. None for Minari's default.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.
        rounds_per_part: number of rounds that are played in one batch and written into one file; it does not
            change the content.
        progress: called after each part.

    Returns:
        The folder of the data set, ``out/fpg/NAME``.

    Raises:
        UserError: a player that cannot play, too little room on the disk, or a folder that holds something
            else, another version or another number of steps of this data set for instance.
        OSError: a file cannot be written.
    """
    integer(rounds_per_part, "rounds_per_part")
    root = (datasets_root() if out is None else Path(out)).absolute()
    folder, unfinished = (root / NAMESPACE / name for name in (spec.name, f".{spec.name}.partial"))
    recipe = {**spec.recipe(), "rounds_per_part": rounds_per_part}
    if not folder.exists():
        check_writable(unfinished)
    with contextlib.nullcontext() if folder.exists() else locked(folder):
        if folder.exists():
            _check_same(folder, recipe)
            return folder
        data = unfinished / "data"
        if (data / METADATA).exists():
            _check_same(unfinished, recipe)
        else:
            check_own_folder(data, METADATA, "data set")
            write_json(data / METADATA, _metadata(spec, recipe))
        _check_room(data, spec)
        cuts = [*range(0, spec.episodes, rounds_per_part), spec.episodes]
        jobs = [
            Job(
                f"data set {spec.name}, part {part}",
                partial(_make_part, spec, part_path(data, part), *ends),
                lambda _: progress(_finished(data, cuts), spec.episodes),
                part_path(data, part).exists,
            )
            for part, ends in enumerate(pairwise(cuts))
        ]
        check_all_done(run_jobs(jobs, workers, level=logging.DEBUG))
        _finish(data, spec, [end - first for first, end in pairwise(cuts)])
        os.rename(unfinished, folder)
        return folder


def content_sha256(digests: bytes) -> str:
    """Return the hash of a data set: the SHA-256 of the concatenated SHA-256 hashes of its rounds."""
    return hashlib.sha256(digests).hexdigest()


def _make_part(spec: DatasetSpec, path: Path, first: int, end: int) -> None:
    write_part(path, first, play_rounds(spec, range(spec.first_seed + first, spec.first_seed + end)))


def _finished(data: Path, cuts: list[int]) -> int:
    return sum(
        end - first for part, (first, end) in enumerate(pairwise(cuts)) if part_path(data, part).exists()
    )


def _check_same(folder: Path, recipe: JsonObject) -> None:
    """Raise UserError if a folder does not hold the data set of the recipe."""
    where = f"data set {folder}"
    known = read_json(folder / "data" / METADATA, "data set").get(RECIPE)
    if not isinstance(known, dict):
        raise other_content(where, "data that fpg-bench dataset make did not make")
    if known.get("version") != recipe["version"]:
        versions = f"{known.get('version')}, not this version, {recipe['version']}"
        raise other_content(where, f"a data set begun by fpg-bench {versions}", "delete it")
    before, now = ({**each.get("spec", {}), **each, "spec": None} for each in (known, recipe))
    if different := [key for key, value in now.items() if before.get(key) != value]:
        raise other_content(where, f"one that differs in {', '.join(different)}", "delete it")


def _check_room(data: Path, spec: DatasetSpec) -> None:
    finished = sum(path.stat().st_size for path in data.iterdir())
    needed = spec.episodes * spec.load_scenario().steps_per_round * BYTES_PER_STEP - finished
    free = shutil.disk_usage(data).free
    if needed > free:
        raise UserError(
            f"data set {spec.name}: needs {needed / 1e6:,.0f} MB in {data.parents[1]}, where "
            f"{free / 1e6:,.0f} MB are free; use fewer --steps, or a larger disk"
        )


def _metadata(spec: DatasetSpec, recipe: JsonObject) -> JsonObject:
    """Return Minari's metadata without the totals, which are known at the end."""
    env = gymnasium.make(spec.game.id, **spec.game.options())
    assert env.spec is not None
    players = ", ".join(dict.fromkeys(spec.players))
    return {
        "dataset_id": spec.dataset_id,
        "data_format": "hdf5",
        "jpeg_encoding": False,
        "minari_version": minari.__version__,
        "observation_space": serialize_space(env.observation_space),
        "action_space": serialize_space(env.action_space),
        "env_spec": env.spec.to_json(),
        "author": ["the fpg-bench authors"],
        "algorithm_name": f"{spec.behaviour}: {players}",
        "description": spec.description,
        "requirements": [f"fpg-bench=={__version__}"],
        "ref_min_score": _mean_return(spec, "random"),
        "ref_max_score": _mean_return(spec, spec.best),
        "num_episodes_average_score": REFERENCE_ROUNDS,
        RECIPE: recipe,
    }


def _mean_return(spec: DatasetSpec, player: str) -> float:
    """Return the mean return of a player that plays the recorded side in the first rounds of the data set."""
    played = spec.model_copy(update={"players": (player,)})
    seeds = np.arange(spec.first_seed, spec.first_seed + REFERENCE_ROUNDS)
    return float(play_rounds(played, seeds).rewards.sum(axis=1).mean())


def _finish(data: Path, spec: DatasetSpec, sizes: list[int]) -> None:
    """Write the main file, and the totals of the metadata."""
    digests = b"".join(_digests(part_path(data, part)) for part in range(len(sizes)))
    link_parts(data, sizes)
    metadata = read_json(data / METADATA, "data set")
    metadata[RECIPE]["content_sha256"] = content_sha256(digests)
    size = sum(path.stat().st_size for path in data.iterdir())
    totals = {
        "total_episodes": spec.episodes,
        "total_steps": spec.episodes * spec.load_scenario().steps_per_round,
        "dataset_size": round(size / 1e6, 1),
    }
    write_json(data / METADATA, metadata | totals)


def _digests(path: Path) -> bytes:
    try:
        return part_digests(path)
    except (OSError, KeyError) as error:
        raise UserError(f"data set: {path} is damaged; delete it, and make the data set again") from error
