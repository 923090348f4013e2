"""Checkpoints of a training run: each a folder that is there whole or not at all, only the newest kept."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any, cast

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from fpg_bench.errors import UserError
from fpg_bench.files import read_json, write_json
from fpg_bench.training.algorithms import Algorithm
from fpg_bench.training.hyperparameters import Hyperparameters
from fpg_bench.training.models import wrapped

MODEL, NORMALIZE, REPLAY, PROGRESS = "model.zip", "normalize.pkl", "replay_buffer.pkl", "progress.json"


def save_model(model: BaseAlgorithm, folder: Path) -> None:
    """Write what SB3 itself can load: the model, and the statistics of its ``VecNormalize``."""
    folder.mkdir(parents=True, exist_ok=True)
    model.save(folder / MODEL)
    if (normalize := model.get_vec_normalize_env()) is not None:
        normalize.save(str(folder / NORMALIZE))


def save_checkpoint(model: BaseAlgorithm, folder: Path, **progress: Any) -> None:
    """Write all that a run goes on from, under a temporary name, then drop the checkpoints before it.

    Args:
        model: its weights, optimiser, counters, normalisation and replay buffer are kept.
        folder: the run's folder of checkpoints.
        **progress: what else is to be known when the run goes on.
    """
    done = folder / f"{model.num_timesteps:012d}"
    if not done.exists():
        written = folder / f".{done.name}"
        shutil.rmtree(written, ignore_errors=True)
        save_model(model, written)
        if getattr(model, "replay_buffer", None) is not None:
            model.save_replay_buffer(written / REPLAY)  # type: ignore[attr-defined]
        write_json(written / PROGRESS, progress)
        os.replace(written, done)
    for other in folder.iterdir():
        if other != done:
            shutil.rmtree(other)


def newest_checkpoint(folder: Path) -> Path | None:
    """The checkpoint of the most steps, None where there is none."""
    found = [path for path in folder.glob("*") if path.name.isdigit()]
    return max(found, default=None)


def load_checkpoint(
    checkpoint: Path, algorithm: Algorithm, games: VecEnv, parameters: Hyperparameters, seed: int
) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """The model of a checkpoint on a batch of games, and what was said of its progress.

    SB3's files hold pickles: only a checkpoint of one's own run is ever read.

    Args:
        checkpoint: from one's own run folder.
        algorithm: what wrote it.
        games: it goes on in these.
        parameters: those of the run.
        seed: of everything that is drawn from now on.

    Raises:
        UserError: a file that is truncated, or of another version.
    """
    try:
        progress = read_json(checkpoint / PROGRESS, "checkpoint")
        if not isinstance(progress.get("seconds"), int | float):
            raise UserError(f"{PROGRESS} lacks seconds, a number")
        model = _load(checkpoint, algorithm, games, parameters, seed)
    except Exception as error:  # torch, zipfile and pickle raise many kinds
        said = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"checkpoint {checkpoint}: cannot be read ({said}); begin the run again with --restart"
        ) from error
    return model, progress


def load_weights(model: BaseAlgorithm, run: Path) -> None:
    """Let a new model begin with the weights, optimiser and normalisation that a finished run ended with.

    SB3's files hold pickles: only one's own runs are ever read.

    Args:
        model: of the same algorithm, networks and normalisation; it counts its steps from zero.
        run: the folder of the run.

    Raises:
        UserError: no finished run of this algorithm and networks, or a file that is truncated.
    """
    try:
        _, parameters, variables = load_from_zip_file(run / MODEL, device="cpu", load_data=False)
        model.set_parameters(cast(Any, parameters), device="cpu")
        for name, value in (variables or {}).items():  # SAC's entropy coefficient
            recursive_setattr(model, f"{name}.data", value.data)
        if (normalize := model.get_vec_normalize_env()) is not None:
            kept = VecNormalize.load(str(run / NORMALIZE), normalize.venv)
            normalize.ret_rms = kept.ret_rms
            if normalize.norm_obs:
                normalize.obs_rms = kept.obs_rms
    except Exception as error:  # torch, zipfile and pickle raise many kinds
        said = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"start {run}: no finished run of {type(model).__name__} with these networks ({said})"
        ) from error


def _load(
    checkpoint: Path, algorithm: Algorithm, games: VecEnv, parameters: Hyperparameters, seed: int
) -> BaseAlgorithm:
    env = wrapped(games, parameters)
    if isinstance(env, VecNormalize):
        env = VecNormalize.load(str(checkpoint / NORMALIZE), env.venv)
    set_random_seed(seed)
    model: BaseAlgorithm = algorithm.kind.load(checkpoint / MODEL, env=env, device="cpu")
    if (checkpoint / REPLAY).exists():
        model.load_replay_buffer(checkpoint / REPLAY)  # type: ignore[attr-defined]
    model.action_space.seed(seed)
    return model
