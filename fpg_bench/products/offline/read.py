"""Reading of data sets through Minari, with checks of their hash, seeds, shapes and ends."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import minari
import numpy as np

from fpg_bench.common.errors import UserError, first_line, nearest
from fpg_bench.common.files import check_regular, read_json
from fpg_bench.common.schema import parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.batch import read_only
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.products.offline.make import METADATA, RECIPE, content_sha256, datasets_root
from fpg_bench.products.offline.rounds import round_digest
from fpg_bench.products.offline.spec import NAMESPACE, DatasetSpec, spec_names
from fpg_bench.products.offline.storage import check_files

ARRAYS = ("observations", "actions", "rewards")


@dataclass(frozen=True)
class Dataset:
    """A data set on disk.

    Attributes:
        path: the folder with ``metadata.json``.
        spec: its specification.
        sha256: hash of its content.
    """

    path: Path
    spec: DatasetSpec
    sha256: str

    @property
    def name(self) -> str:
        """The name that :func:`open_dataset` takes: that in Minari's folder, elsewhere the folder."""
        home = datasets_root() / NAMESPACE / self.spec.name
        return self.spec.name if self.path.is_relative_to(home) else str(self.path)

    def read(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Read all N rounds of T steps, read-only: those of the last data set are cached.

        Returns:
            Observations ``(N, T + 1, 15)`` float32, actions ``(N, T, 9)`` float32 or ``(N, T)`` int64, and
            rewards ``(N, T)`` float32.

        Raises:
            UserError: a damaged file, or content that has changed.
        """
        return _read(self)


def find_datasets(folder: str | Path) -> list[Path]:
    """Return the folders with ``metadata.json`` of all finished data sets in a folder.

    Raises:
        UserError: there is none.
    """
    folder = Path(folder)
    if folder.is_dir() and not os.access(folder, os.R_OK):
        raise UserError(f"data set {folder}: cannot be read: Permission denied")
    found = sorted(path.parent for path in folder.rglob(METADATA))
    finished = [
        path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts)
    ]
    if not finished:
        raise UserError(f"data set {folder}: holds no {'finished ' if found else ''}data set")
    return finished


def open_dataset(name: str | Path) -> Dataset:
    """Open the data set in a folder, or in Minari's folder by its name or id.

    Args:
        name: a folder, ``ally-mixed-v0``, or ``fpg/ally-mixed-v0``.

    Raises:
        UserError: there is none, several, one that is not finished, or one whose scenario or players have
            changed in this version.
    """
    word = str(name).removeprefix(f"{NAMESPACE}/")
    folder = Path(name) if Path(name).exists() else datasets_root() / NAMESPACE / word
    if not folder.exists():
        if word in spec_names():
            raise UserError(
                f"data set {word}: is not in {folder.parent}; make it with fpg-bench dataset make {word}"
            )
        raise UserError(f"data set {name}: no such folder or data set{nearest(word, spec_names())}")
    found = find_datasets(folder)
    if len(found) > 1:
        raise UserError(f"data set {folder}: holds {len(found)} data sets; name one, {found[0].parent}")
    spec, sha256 = checked_recipe(read_json(found[0] / METADATA, "data set"), f"data set {found[0]}")
    return Dataset(found[0], spec, sha256)


def checked_recipe(metadata: JsonObject, where: str) -> tuple[DatasetSpec, str]:
    """Return the specification and the hash in the metadata, if this version plays the same rounds.

    Raises:
        UserError: it plays other rounds, or the data set is not finished; ``where`` begins the message.
    """
    recipe = metadata.get(RECIPE)
    if not isinstance(recipe, dict) or not isinstance(recipe.get("content_sha256"), str):
        raise UserError(f"{where}: was not made by fpg-bench dataset make, or is not finished")
    maker = f"{where}, made by fpg-bench {recipe.get('version')}"
    spec = parse(DatasetSpec, recipe.get("spec"), maker)
    now = spec.recipe()
    for key, what in (("scenario_sha256", f"scenario {spec.scenario!r}"), ("identities", "a player")):
        if recipe.get(key) != now[key]:
            raise UserError(f"{maker}: {what} differs in this version, {now['version']}; make it again")
    return spec, recipe["content_sha256"]


def iterate_rounds(
    data: str | Path, spec: DatasetSpec, sha256: str, where: str
) -> Iterator[tuple[int, minari.EpisodeData]]:
    """Yield all rounds as Minari reads them, after checking their seed, shapes and ends.

    Raises:
        UserError: a round that differs or cannot be read, or, after the last one, another hash of the
            content; ``where`` begins the message.
    """
    steps = spec.load_scenario().steps_per_round
    ends = {"terminations": np.zeros(steps, bool), "truncations": np.arange(steps) == steps - 1}
    k, digests = 0, []
    try:
        for file in Path(data).iterdir():
            check_regular(file)
        dataset = minari.MinariDataset(data)
        check_files(Path(data), 8 * (steps + 1) * OBSERVATION_SIZE)
        seeds = [about.get("seed") for about in dataset.storage.get_episode_metadata(range(spec.episodes))]
        for k, episode in enumerate(dataset.iterate_episodes(range(spec.episodes))):
            if seeds[k] != spec.first_seed + k:
                raise UserError(f"{where}: round {k} has the seed {seeds[k]}, expected {spec.first_seed + k}")
            for name, expected in ends.items():
                if not np.array_equal(getattr(episode, name), expected):
                    raise UserError(f"{where}: round {k}: {name} are not those of a whole round")
            digests.append(round_digest(*(getattr(episode, name) for name in ARRAYS)))
            yield k, episode
        if content_sha256(b"".join(digests)) != sha256:
            raise UserError(f"{where}: its content has changed (sha256); make it again")
    except UserError:
        raise
    except Exception as error:  # h5py and Minari raise many types for damaged and foreign files
        raise UserError(f"{where}: cannot be read from round {k} on: {first_line(error)}") from error


@functools.lru_cache(maxsize=1)
def _read(dataset: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rounds = iterate_rounds(dataset.path, dataset.spec, dataset.sha256, f"data set {dataset.path}")
    arrays = [[getattr(episode, name) for name in ARRAYS] for _, episode in rounds]
    observations, actions, rewards = map(np.stack, zip(*arrays, strict=True))
    return read_only(observations), read_only(actions), read_only(rewards.astype(np.float32))
