"""Checks data sets: their hash, and a sample of their rounds, which is played again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import minari
import numpy as np

from fpg_bench.common.errors import UserError, first_line
from fpg_bench.common.files import read_json
from fpg_bench.common.schema import parse
from fpg_bench.datasets.make import METADATA, RECIPE, ROUNDS_PER_PART, content_sha256
from fpg_bench.datasets.rounds import play_rounds, round_digest
from fpg_bench.datasets.spec import DatasetSpec

_ARRAYS = ("observations", "actions", "rewards")


def find_datasets(folder: str | Path) -> list[Path]:
    """Return the folders of the finished data sets in a folder, or itself, that hold ``metadata.json``.

    Raises:
        UserError: there is none.
    """
    folder = Path(folder)
    found = sorted(path.parent for path in folder.rglob(METADATA))
    finished = [
        path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts)
    ]
    if not finished:
        raise UserError(f"data set {folder}: holds no {'finished ' if found else ''}data set")
    return finished


def check_dataset(
    data: str | Path,
    sample: float = 0.01,
    sample_seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> str:
    """Read a data set as Minari does, compare its hash, play a sample of its rounds again, and compare these.

    Args:
        data: the folder with ``metadata.json``.
        sample: share of rounds to play again, above 0 and at most 1; at least one round.
        sample_seed: seed of the draw of these rounds.
        progress: called with the number of rounds that were read, and of all.

    Returns:
        One line on what was compared.

    Raises:
        UserError: anything that differs, or cannot be read or played; the message names the first round.
    """
    where = f"data set {data}"
    if not 0 < sample <= 1:
        raise UserError(f"sample: expected a share above 0 and at most 100 %, got {100 * sample:g} %")
    metadata = read_json(Path(data) / METADATA, "data set")
    spec, sha256 = _checked_recipe(metadata, where)
    count = spec.episodes
    if metadata.get("total_episodes") != count:
        raise UserError(f"{where}: has {metadata.get('total_episodes')} rounds, expected {count}")
    drawn = np.random.default_rng(sample_seed).choice(count, math.ceil(sample * count), replace=False)
    sampled = set(drawn.tolist())
    digests, kept = [], []
    for k, episode in _episodes(data, spec, where):
        digests.append(round_digest(*(getattr(episode, name) for name in _ARRAYS)))
        if k in sampled:
            kept.append(episode)
        if k % ROUNDS_PER_PART == 0:
            progress(k, count)
        if len(kept) == ROUNDS_PER_PART or (k == count - 1 and kept):
            _compare(spec, kept, where)
            kept.clear()
    if content_sha256(b"".join(digests)) != sha256:
        raise UserError(f"{where}: its content has changed (sha256); make it again")
    return (
        f"{spec.dataset_id}: {count} rounds of {len(episode.rewards)} steps, sha256 {sha256[:16]}; "
        f"{len(sampled)} played again, all identical"
    )


def _checked_recipe(metadata: dict[str, Any], where: str) -> tuple[DatasetSpec, str]:
    """Return the specification and the hash that metadata name, if this version plays the same."""
    recipe = metadata.get(RECIPE)
    if not isinstance(recipe, dict) or not isinstance(recipe.get("content_sha256"), str):
        raise UserError(f"{where}: was not made by fpg-bench dataset make, or is not finished")
    maker = f"{where}, made by fpg-bench {recipe.get('version')}"
    spec = parse(DatasetSpec, recipe.get("spec"), maker)
    now = spec.recipe()
    for key, what in (("scenario_sha256", f"scenario {spec.scenario!r}"), ("identities", "a player")):
        if recipe.get(key) != now[key]:
            raise UserError(
                f"{maker}: {what} is another one in this version, {now['version']}; make it again"
            )
    return spec, recipe["content_sha256"]


def _episodes(data: str | Path, spec: DatasetSpec, where: str) -> Iterator[tuple[int, minari.EpisodeData]]:
    """Yield all rounds as Minari reads them, after a look at their seed, shapes and ends."""
    steps = spec.load_scenario().steps_per_round
    ends = {"terminations": np.zeros(steps, bool), "truncations": np.arange(steps) == steps - 1}
    k = 0
    try:
        dataset = minari.MinariDataset(data)
        seeds = [about.get("seed") for about in dataset.storage.get_episode_metadata(range(spec.episodes))]
        for k, episode in enumerate(dataset.iterate_episodes(range(spec.episodes))):
            if seeds[k] != spec.first_seed + k:
                raise UserError(f"{where}: round {k} has the seed {seeds[k]}, expected {spec.first_seed + k}")
            for name, expected in ends.items():
                if not np.array_equal(getattr(episode, name), expected):
                    raise UserError(f"{where}: round {k}: {name} are not those of a whole round")
            yield k, episode
    except UserError:
        raise
    except Exception as error:  # h5py and Minari raise many kinds for torn and foreign files
        raise UserError(f"{where}: cannot be read from round {k} on: {first_line(error)}") from error


def _compare(spec: DatasetSpec, episodes: list[minari.EpisodeData], where: str) -> None:
    """Play rounds again; raise UserError for the first that differs."""
    played = play_rounds(spec, [spec.first_seed + int(episode.id) for episode in episodes])
    for k, episode in enumerate(episodes):
        for name in _ARRAYS:
            kept, now = getattr(episode, name), getattr(played, name)[k]
            if not np.array_equal(kept, now):
                by = f" (by up to {np.abs(kept - now).max():.1g})" if kept.shape == now.shape else ""
                raise UserError(f"{where}: round {episode.id}: {name} are not those that its seed gives{by}")
