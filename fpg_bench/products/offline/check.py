"""Check of data sets: their hash, and a replayed sample of their rounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import minari
import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.products.offline.make import METADATA, ROUNDS_PER_PART
from fpg_bench.products.offline.read import ARRAYS, checked_recipe, iterate_rounds
from fpg_bench.products.offline.rounds import play_rounds
from fpg_bench.products.offline.spec import DatasetSpec


def check_dataset(
    data: str | Path,
    sample: float = 0.01,
    sample_seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> str:
    """Read a data set through Minari, and check its hash and a replayed sample of its rounds.

    Args:
        data: the folder with ``metadata.json``.
        sample: share of rounds to play again, above 0 and at most 1; at least one round.
        sample_seed: seed of the draw of these rounds.
        progress: called with the number of rounds read and the total.

    Returns:
        One line that describes what was checked.

    Raises:
        UserError: something differs, or cannot be read or played; the message names the first such round.
    """
    where = f"data set {data}"
    if not 0 < sample <= 1:
        raise UserError(f"sample: expected a share above 0 and at most 100 %, got {100 * sample:g} %")
    metadata = read_json(Path(data) / METADATA, "data set")
    spec, sha256 = checked_recipe(metadata, where)
    count = spec.episodes
    if metadata.get("total_episodes") != count:
        raise UserError(f"{where}: has {metadata.get('total_episodes')} rounds, expected {count}")
    drawn = np.random.default_rng(sample_seed).choice(count, math.ceil(sample * count), replace=False)
    sampled = set(drawn.tolist())
    kept = []
    for k, episode in iterate_rounds(data, spec, sha256, where):
        if k in sampled:
            kept.append(episode)
        if k % ROUNDS_PER_PART == 0:
            progress(k, count)
        if len(kept) == ROUNDS_PER_PART or (k == count - 1 and kept):
            _compare(spec, kept, where)
            kept.clear()
    return (
        f"{spec.dataset_id}: {count} rounds of {len(episode.rewards)} steps, sha256 {sha256[:16]}; "
        f"{len(sampled)} played again, all identical"
    )


def _compare(spec: DatasetSpec, episodes: list[minari.EpisodeData], where: str) -> None:
    """Play rounds again; raise UserError for the first that differs."""
    played = play_rounds(spec, [spec.first_seed + int(episode.id) for episode in episodes])
    for k, episode in enumerate(episodes):
        for name in ARRAYS:
            kept, now = getattr(episode, name), getattr(played, name)[k]
            if not np.array_equal(kept, now):
                by = f" (by up to {np.abs(kept - now).max():.1g})" if kept.shape == now.shape else ""
                raise UserError(f"{where}: round {episode.id}: {name} are not those that its seed gives{by}")
