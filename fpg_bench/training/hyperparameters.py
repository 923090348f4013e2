"""Hyper-parameters as data: one YAML file per algorithm, keyed by environment id, in rl-zoo3's format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fpg_bench.checks import mapping, whole
from fpg_bench.errors import UserError, nearest
from fpg_bench.files import read_yaml
from fpg_bench.ids import VIEWS
from fpg_bench.players.agent import baselines_folder
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.imitation_words import Imitation, parse_imitation

CUSTOM_GAMES = 64  # games at once of a user's own class that says nothing else


@dataclass(frozen=True)
class Hyperparameters:
    """What a file says for one id: the batch of games, the budget, what the observations become, the rest.

    Attributes:
        n_envs: games at once.
        n_timesteps: training budget in steps, over all games; 0: none is given.
        normalize: arguments of SB3's ``VecNormalize``; None: none is used.
        algorithm: arguments of the algorithm's constructor, ``policy`` included.
        frame_stack: how many of the last observations are seen at once; None: one.
        imitate: the player that is imitated first; None: nobody is.
    """

    n_envs: int
    n_timesteps: int
    normalize: dict[str, Any] | None
    algorithm: dict[str, Any]
    frame_stack: int | None = None
    imitate: Imitation | None = None

    def entry(self) -> dict[str, Any]:
        """What a file would say for the id."""
        values: dict[str, Any] = {
            "n_envs": self.n_envs,
            "n_timesteps": self.n_timesteps,
            "normalize": self.normalize,
        }
        values |= {"frame_stack": self.frame_stack, "imitate": self.imitate and asdict(self.imitate)}
        return {name: value for name, value in values.items() if value is not None} | self.algorithm


def load_hyperparameters(
    algorithm: str | Algorithm,
    view_id: str,
    file: str | Path | Mapping[str, Any] | None = None,
    *,
    path: Any = None,
) -> Hyperparameters:
    """The hyper-parameters of an algorithm on an id.

    Args:
        algorithm: its name; see :func:`fpg_bench.training.algorithms.find_algorithm`.
        view_id: ``FPG/AllyVsScripted-v0`` and the like.
        file: a file of the user's, or what it would say for the id; None: the shipped file, and for a class
            of the user's its own defaults with 64 games.
        path: how the opponent flies; where that is by itself, the shipped values are others.

    Raises:
        UserError: an unknown algorithm, no entry for the id, or a missing or ill-formed key.
    """
    found = algorithm if isinstance(algorithm, Algorithm) else find_algorithm(algorithm)
    if isinstance(file, Mapping):
        return _parsed(found, dict(file), f"hyper-parameters: {view_id}")
    if file is None and found.custom:
        return Hyperparameters(CUSTOM_GAMES, 0, None, {"policy": "MlpPolicy"})
    chosen = _shipped(found, view_id, path) if file is None else Path(file)
    content = read_yaml(chosen, "hyper-parameters")
    if not isinstance(content.get(view_id), dict):
        raise UserError(
            f"hyper-parameters {chosen}: no entry for {view_id!r}{nearest(view_id, map(str, content))}"
        )
    return _parsed(found, dict(content[view_id]), f"hyper-parameters {chosen}: {view_id}")


def _shipped(algorithm: Algorithm, view_id: str, path: Any) -> Path:
    """The shipped file of an algorithm; frames are stacked on the plain algorithm's where it has none."""
    folder = baselines_folder() / "hyperparams"
    names = [algorithm.name, algorithm.base]
    if path == "learned" and view_id in VIEWS and VIEWS[view_id].side == "opponent":
        names.insert(0, f"{algorithm.base}-learned")
    files = [folder / f"{name}.yml" for name in names]
    return next((file for file in files if file.is_file()), files[-1])


def _parsed(algorithm: Algorithm, values: dict[str, Any], where: str) -> Hyperparameters:
    for key in ("n_envs", "n_timesteps"):
        whole(values.get(key), f"{where}: {key}")
    normalize = values.pop("normalize", None)
    if normalize is not None:
        mapping(normalize, f"{where}: normalize")
    named, frames = algorithm.frame_stack, values.pop("frame_stack", algorithm.frame_stack)
    if frames is not None:
        whole(frames, f"{where}: frame_stack")
    if named is not None and frames != named:
        raise UserError(f"{where}: frame_stack: {algorithm.name} has {named}, got {frames}")
    imitate = values.pop("imitate", None)
    imitation = None if imitate is None else parse_imitation(imitate, f"{where}: imitate")
    games, steps = values.pop("n_envs"), values.pop("n_timesteps")
    return Hyperparameters(games, steps, normalize, values, frames, imitation)
