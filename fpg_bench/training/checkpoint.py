"""Checkpoints of a training run without pickles; only the newest complete one is kept.

The model's zip is SB3's own, so that SB3 can load it. Here only its tensors are read; no pickle is opened.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, cast

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecNormalize

from fpg_bench.common.checks import finite
from fpg_bench.common.errors import UserError, one_line
from fpg_bench.common.files import check_unpacked, read_json, write_json

MODEL, NORMALIZE, REPLAY, PROGRESS = "model.zip", "normalize.npz", "replay_buffer.npz", "progress.json"
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "_current_progress_remaining")


def save_model(model: BaseAlgorithm, folder: Path) -> None:
    """Save the model in SB3's own format, and the statistics of its ``VecNormalize`` as arrays."""
    folder.mkdir(parents=True, exist_ok=True)
    model.save(folder / MODEL)
    if (normalize := model.get_vec_normalize_env()) is not None:
        statistics = _statistics(normalize).items()
        arrays = {f"{name}_{key}": value for name, rms in statistics for key, value in vars(rms).items()}
        np.savez(folder / NORMALIZE, **arrays)


def save_checkpoint(model: BaseAlgorithm, folder: Path, *, seconds: float) -> None:
    """Save a checkpoint under a temporary name, rename it, and remove the older ones.

    Args:
        model: its weights, optimizer, counters, normalization and replay buffer are saved.
        folder: the run's folder of checkpoints.
        seconds: training time so far.
    """
    checkpoint = folder / f"{model.num_timesteps:012d}"
    if not checkpoint.exists():
        temporary = folder / f".{checkpoint.name}"
        shutil.rmtree(temporary, ignore_errors=True)
        save_model(model, temporary)
        if (buffer := getattr(model, "replay_buffer", None)) is not None:
            np.savez(temporary / REPLAY, **_arrays(buffer), pos=buffer.pos, full=buffer.full)
        counters = {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)}
        write_json(temporary / PROGRESS, {"seconds": seconds, **counters})
        os.replace(temporary, checkpoint)
    for other in folder.iterdir():
        if other != checkpoint:
            shutil.rmtree(other)


def steps_of(checkpoint: Path) -> int:
    """Return the number of steps after which a checkpoint was saved."""
    return int(checkpoint.name)


def newest_checkpoint(folder: Path) -> Path | None:
    """Return the checkpoint with the most steps; None if there is none."""
    checkpoints = [path for path in folder.glob("*") if path.name.isdigit()]
    return max(checkpoints, default=None)


def load_checkpoint(checkpoint: Path, model: BaseAlgorithm, seed: int) -> float:
    """Load a checkpoint into a new model of the same run.

    Args:
        checkpoint: its folder.
        model: a new model with the run's hyper-parameters.
        seed: random seed from here on.

    Returns:
        The training time so far in seconds.

    Raises:
        UserError: a file is truncated, or belongs to another run or version.
    """
    try:
        progress = read_json(checkpoint / PROGRESS, "checkpoint")
        seconds = finite(progress.get("seconds"), f"{PROGRESS}: seconds")
        _load_model(model, checkpoint)
        for name in _COUNTERS:
            if hasattr(model, name):
                setattr(model, name, type(getattr(model, name))(progress[name]))
        if (buffer := getattr(model, "replay_buffer", None)) is not None:
            _fill(buffer, _read(checkpoint / REPLAY))
        set_random_seed(seed)
        model.action_space.seed(seed)
    except Exception as error:  # torch, zipfile and NumPy raise many types
        raise UserError(
            f"checkpoint {checkpoint}: cannot be read ({one_line(error)}); start over with --restart"
        ) from error
    return float(seconds)


def load_weights(model: BaseAlgorithm, run: Path) -> None:
    """Load the weights, optimizer and normalization of a finished run into a new model.

    Args:
        model: of the same algorithm, networks and normalization; it counts its steps from zero.
        run: folder of the run.

    Raises:
        UserError: not a finished run of this algorithm and networks, or a truncated file.
    """
    try:
        _load_model(model, run)
    except Exception as error:  # torch, zipfile and NumPy raise many types
        raise UserError(
            f"start {run}: no finished run of {type(model).__name__} with these networks ({one_line(error)})"
        ) from error


def _load_model(model: BaseAlgorithm, folder: Path) -> None:
    """Load tensors and statistics; the pickles of the zip are never opened."""
    parameters, variables = read_model(folder / MODEL)
    model.set_parameters(cast(Any, parameters), device="cpu")
    for name, value in (variables or {}).items():  # SAC's entropy coefficient
        recursive_setattr(model, f"{name}.data", value.data)
    if (normalize := model.get_vec_normalize_env()) is not None:
        arrays = _read(folder / NORMALIZE)
        for name, rms in _statistics(normalize).items():
            for key, value in vars(rms).items():
                array = _of_shape(arrays[f"{name}_{key}"], np.shape(value))
                setattr(rms, key, float(array) if key == "count" else array)


def read_model(path: Path) -> tuple[Any, Any]:
    """Return the weights and the variables in a zip of SB3; its pickles are never opened.

    Raises:
        OSError: it is no regular file, or unpacks to far more than it holds.
        ValueError: it is no zip of SB3. Torch and zipfile raise other types, too.
    """
    check_unpacked(path, inner=".pth")
    try:
        _, parameters, variables = load_from_zip_file(path, device="cpu", load_data=False)
    except UnpicklingError:  # torch advises to run what is in it
        raise ValueError(f"{path.name} holds more than plain tensors, or is damaged") from None
    return parameters, variables


def _statistics(normalize: VecNormalize) -> dict[str, Any]:
    """Return the running means of returns and, if they are normalized, of observations."""
    return {"ret": normalize.ret_rms} | ({"obs": normalize.obs_rms} if normalize.norm_obs else {})


def _arrays(buffer: object) -> dict[str, Any]:
    """Return the arrays of a replay buffer, by attribute."""
    return {name: value for name, value in vars(buffer).items() if isinstance(value, np.ndarray)}


def _fill(buffer: Any, saved: Mapping[str, np.ndarray]) -> None:
    """Fill an empty replay buffer with the saved arrays."""
    for name, array in _arrays(buffer).items():
        array[...] = _of_shape(saved[name], array.shape)
    buffer.pos, buffer.full = int(saved["pos"]), bool(saved["full"])


def _of_shape(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if array.shape != shape:
        raise UserError(f"an array has the shape {array.shape}, expected {shape}")
    return array


def _read(file: Path) -> dict[str, np.ndarray]:
    check_unpacked(file)
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)
