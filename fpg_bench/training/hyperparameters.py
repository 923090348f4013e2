"""Hyper-parameters as data: one YAML file per algorithm, keyed by environment id, in rl-zoo3's format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.files import read_yaml
from fpg_bench.players.agent import baselines_folder

ALGORITHMS = ("ppo", "sac", "td3")


@dataclass(frozen=True)
class Hyperparameters:
    """What a file says for one id: the batch of games, the budget, reward and observation scaling, the rest.

    Attributes:
        n_envs: games at once.
        n_timesteps: training budget in steps, over all games.
        normalize: arguments of SB3's ``VecNormalize``; None: none is used.
        algorithm: arguments of the algorithm's constructor, ``policy`` included.
    """

    n_envs: int
    n_timesteps: int
    normalize: dict[str, Any] | None
    algorithm: dict[str, Any]


def load_hyperparameters(algorithm: str, view_id: str, file: Path | None = None) -> Hyperparameters:
    """The hyper-parameters of an algorithm on an id, from the shipped file or the user's own.

    Raises:
        UserError: an unknown algorithm, no entry for the id, or a missing or ill-formed key.
    """
    if algorithm not in ALGORITHMS:
        raise UserError(f"unknown algorithm {algorithm!r}{nearest(algorithm, ALGORITHMS)}")
    path = file or baselines_folder() / "hyperparams" / f"{algorithm}.yml"
    content = read_yaml(path, "hyper-parameters")
    if not isinstance(content.get(view_id), dict):
        raise UserError(
            f"hyper-parameters {path}: no entry for {view_id!r}{nearest(view_id, map(str, content))}"
        )
    values = dict(content[view_id])
    for key in ("n_envs", "n_timesteps"):
        if isinstance(values.get(key), bool) or not isinstance(values.get(key), int) or values[key] < 1:
            raise UserError(f"hyper-parameters {path}: {view_id}: {key}: expected a whole number above 0")
    normalize = values.pop("normalize", None)
    if normalize is not None and not isinstance(normalize, dict):
        raise UserError(
            f"hyper-parameters {path}: {view_id}: normalize: expected a mapping, got {normalize!r}"
        )
    return Hyperparameters(values.pop("n_envs"), values.pop("n_timesteps"), normalize, values)
