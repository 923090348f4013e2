"""One training run: an SB3 algorithm on an id, into a folder that says how it was made."""

from __future__ import annotations

import os
import platform
import shlex
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from fpg_bench.envs.sb3 import SB3View, make_sb3
from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.files import read_json, write_json
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.ids import find_view
from fpg_bench.training.callbacks import GameMeasures, TrainingBar
from fpg_bench.training.export import export_agent
from fpg_bench.training.hyperparameters import Hyperparameters, load_hyperparameters
from fpg_bench.training.language_model import TRANSCRIPT, training_planner

_CLASSES: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "td3": TD3}
_PACKAGES = ("fpg-bench", "stable-baselines3", "torch", "gymnasium", "numpy", "numba", "onnx", "onnxruntime")


def train(
    algorithm: str,
    view_id: str,
    out: str | Path,
    *,
    seed: int = 0,
    steps: int | None = None,
    hyperparams: str | Path | None = None,
    progress: bool = True,
    restart: bool = False,
    transcript: str | Path | None = None,
    **options: Any,
) -> Path:
    """Train an algorithm on an id and export the agent.

    The folder then holds ``run.json``, ``model.zip``, the TensorBoard log and ``agent/`` (``agent.json``,
    ``policy.onnx``). A finished run is not repeated; a stopped one leaves ``model.zip`` as it was then.

    A language model plans beside the game: each round flies the newest plan that is there. How far that is
    behind depends on the server's speed, so ``transcript.jsonl`` keeps what each round flew.

    Args:
        algorithm: ``ppo``, ``sac`` or ``td3``.
        view_id: ``FPG/AllyVsScripted-v0`` and the like.
        out: the run's folder.
        seed: the training seed k; games begin at seed k * 10^6.
        steps: the budget over all games; None: the hyper-parameter file's.
        hyperparams: a YAML file of one's own; None: the shipped one.
        progress: whether to draw a bar, or print lines where standard output is no terminal.
        restart: whether to begin an unfinished run of the folder again, from the start.
        transcript: of a run with a language model: fly its plans again, without a server.
        **options: those of :class:`fpg_bench.envs.one_sided.OneSided`.

    Returns:
        The agent's folder.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another or an unfinished run.
        KeyboardInterrupt: stopped by the user; the model is saved.
    """
    torch.set_num_threads(1)
    out = Path(out)
    parameters = load_hyperparameters(
        algorithm, find_view(view_id).id, Path(hyperparams) if hyperparams else None
    )
    if steps is not None and steps < 1:
        raise UserError(f"steps: expected a whole number above 0, got {steps}")
    budget = parameters.n_timesteps if steps is None else steps
    planner = training_planner(options.get("planner") or find_view(view_id).planner, out, transcript)
    played = options | {"planner": planner}
    games = make_sb3(view_id, parameters.n_envs, training_seed(seed), stagger=True, **played)
    about = _about(algorithm, games, seed, budget, parameters, options | {"transcript": transcript})
    if _is_finished(out, about, restart):
        return out / "agent"
    (out / TRANSCRIPT).unlink(missing_ok=True)
    write_json(out / "run.json", about | {"finished": False})
    model = make_model(algorithm, games, parameters, seed)
    model.set_logger(configure(str(out), ["tensorboard"]))
    seconds = _learn(model, budget, out, progress)
    about |= {"steps_done": model.num_timesteps, "seconds": round(seconds, 1)}
    difference = export_agent(model, out / "agent", about)
    rate = round(model.num_timesteps / seconds)
    write_json(
        out / "run.json", about | {"finished": True, "steps_per_s": rate, "largest_difference": difference}
    )
    return out / "agent"


def make_model(algorithm: str, games: VecEnv, parameters: Hyperparameters, seed: int) -> BaseAlgorithm:
    """The SB3 model of an algorithm on a batch of games, normalised as the hyper-parameters say.

    Raises:
        UserError: a hyper-parameter that the algorithm does not have, or not in this form.
    """
    arguments: dict[str, Any] = {"seed": seed, "device": "cpu", **parameters.algorithm}
    if (sd := arguments.pop("noise_std", None)) is not None and arguments.pop("noise_type", "") == "normal":
        arguments["action_noise"] = NormalActionNoise(np.zeros(ACTION_SIZE), np.full(ACTION_SIZE, sd))
    try:
        if parameters.normalize is not None:
            games = VecNormalize(games, gamma=arguments.get("gamma", 0.99), **parameters.normalize)
        return _CLASSES[algorithm](env=games, **arguments)
    except (TypeError, ValueError, AssertionError) as error:
        raise UserError(f"hyper-parameters of {algorithm}: {error}") from error


def _learn(model: BaseAlgorithm, budget: int, out: Path, progress: bool) -> float:
    """Train to the budget; save the model, also when the user stops it. The seconds it took."""
    bar = [TrainingBar(budget)] if progress else []
    callbacks: list[BaseCallback] = [GameMeasures(), *bar]
    start = time.monotonic()
    try:
        model.learn(budget, callback=callbacks, log_interval=1)
    finally:
        for drawn in bar:
            drawn.close()
        model.save(out / "model.zip")
    return time.monotonic() - start


def _about(
    algorithm: str,
    games: SB3View,
    seed: int,
    budget: int,
    parameters: Hyperparameters,
    options: dict[str, Any],
) -> dict[str, Any]:
    """How the run is made: everything needed to make it again."""
    view = games.core.view
    options = {name: value for name, value in options.items() if value is not None}
    words = ["fpg-bench", "train", algorithm, view.id, "--seed", str(seed), "--steps", str(budget)]
    for name, value in options.items():
        words += [
            f"--{name.replace('_', '-')}",
            ",".join(map(str, value)) if isinstance(value, list) else str(value),
        ]
    return {
        "command": shlex.join(words),
        "algorithm": algorithm,
        "id": view.id,
        "side": view.side,
        "scenario": games.core.scenario.hash,
        "training_seed": seed,
        "training_steps": budget,
        "hyperparameters": {
            "n_envs": parameters.n_envs,
            "normalize": parameters.normalize,
            **parameters.algorithm,
        },
        "versions": {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()},
    }


def _is_finished(out: Path, about: dict[str, Any], restart: bool) -> bool:
    """Whether the folder holds this very run, finished; refuses to overwrite any other."""
    if not (out / "run.json").exists():
        if out.exists() and os.listdir(out):
            raise UserError(f"{out}: is not empty and no run's folder; choose another")
        return False
    found = read_json(out / "run.json", "run")
    if any(found.get(key) != about[key] for key in ("command", "hyperparameters", "scenario")):
        raise UserError(
            f"{out}: holds another run ({found.get('command')}), or this one with other hyper-parameters; "
            "choose another folder"
        )
    if not found.get("finished") and not restart:
        raise UserError(
            f"{out}: holds this run unfinished; begin it again with --restart, or choose another folder"
        )
    return bool(found.get("finished"))
