"""Checkpoints of a training run; only the newest complete one is kept."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any, cast

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_json
from fpg_bench.training.algorithms import Algorithm
from fpg_bench.training.hyperparameters import Hyperparameters
from fpg_bench.training.models import wrapped

MODEL, NORMALIZE, REPLAY, PROGRESS = "model.zip", "normalize.pkl", "replay_buffer.pkl", "progress.json"


def save_model(model: BaseAlgorithm, folder: Path) -> None:
    """Save the model and the statistics of its ``VecNormalize`` in SB3's own formats."""
    folder.mkdir(parents=True, exist_ok=True)
    model.save(folder / MODEL)
    if (normalize := model.get_vec_normalize_env()) is not None:
        normalize.save(str(folder / NORMALIZE))


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
        if getattr(model, "replay_buffer", None) is not None:
            model.save_replay_buffer(temporary / REPLAY)  # type: ignore[attr-defined]
        write_json(temporary / PROGRESS, {"seconds": seconds})
        os.replace(temporary, checkpoint)
    for other in folder.iterdir():
        if other != checkpoint:
            shutil.rmtree(other)


def newest_checkpoint(folder: Path) -> Path | None:
    """Return the checkpoint of the most steps, or None where there is none."""
    checkpoints = [path for path in folder.glob("*") if path.name.isdigit()]
    return max(checkpoints, default=None)


def load_checkpoint(
    checkpoint: Path, algorithm: Algorithm, games: VecEnv, parameters: Hyperparameters, seed: int
) -> tuple[BaseAlgorithm, float]:
    """Load the model of a checkpoint onto a batch of games.

    SB3's files hold pickles, so only checkpoints of one's own runs are ever loaded.

    Args:
        checkpoint: from one's own run folder.
        algorithm: the algorithm that wrote it.
        games: the games in which training goes on.
        parameters: hyper-parameters of the run.
        seed: random seed from here on.

    Returns:
        The model, and the training time so far in seconds.

    Raises:
        UserError: a file that is truncated, or of another version.
    """
    try:
        seconds = read_json(checkpoint / PROGRESS, "checkpoint").get("seconds")
        if not isinstance(seconds, int | float):
            raise UserError(f"{PROGRESS} lacks seconds, a number")
        env = wrapped(games, parameters)
        if isinstance(env, VecNormalize):
            env = VecNormalize.load(str(checkpoint / NORMALIZE), env.venv)
        set_random_seed(seed)
        model: BaseAlgorithm = algorithm.kind.load(checkpoint / MODEL, env=env, device="cpu")
        if (checkpoint / REPLAY).exists():
            model.load_replay_buffer(checkpoint / REPLAY)  # type: ignore[attr-defined]
        model.action_space.seed(seed)
    except Exception as error:  # torch, zipfile and pickle raise many kinds
        raise UserError(
            f"checkpoint {checkpoint}: cannot be read ({_one_line(error)}); "
            "begin the run again with --restart"
        ) from error
    return model, seconds


def load_weights(model: BaseAlgorithm, run: Path) -> None:
    """Load the weights, optimizer and normalization of a finished run into a new model.

    SB3's files hold pickles, so only one's own runs are ever loaded.

    Args:
        model: of the same algorithm, networks and normalization; it counts its steps from zero.
        run: folder of the run.

    Raises:
        UserError: no finished run of this algorithm and networks, or a file that is truncated.
    """
    try:
        _, parameters, variables = load_from_zip_file(run / MODEL, device="cpu", load_data=False)
        model.set_parameters(cast(Any, parameters), device="cpu")
        for name, value in (variables or {}).items():  # SAC's entropy coefficient
            recursive_setattr(model, f"{name}.data", value.data)
        if (normalize := model.get_vec_normalize_env()) is not None:
            saved = VecNormalize.load(str(run / NORMALIZE), normalize.venv)
            normalize.ret_rms = saved.ret_rms
            if normalize.norm_obs:
                normalize.obs_rms = saved.obs_rms
    except Exception as error:  # torch, zipfile and pickle raise many kinds
        raise UserError(
            f"start {run}: no finished run of {type(model).__name__} with these networks ({_one_line(error)})"
        ) from error


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
