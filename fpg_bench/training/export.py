"""From a trained SB3 model to an agent folder: normalisation and memory folded in."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import tempfile
import threading
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from torch.distributions import Distribution

from fpg_bench.envs.sb3 import SB3View
from fpg_bench.errors import UserError
from fpg_bench.files import write_json, write_whole
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.imports import reason
from fpg_bench.players.agent import AGENT_FORMAT, OnnxPlayer
from fpg_bench.players.writing import stripped
from fpg_bench.training.actor import Actor
from fpg_bench.training.plain_onnx import OPSET, plain_onnx

GREATEST_DIFFERENCE = 1e-4


def export_onnx(model: BaseAlgorithm) -> bytes:
    """The model's deterministic policy as ONNX: ``observation`` (n, 15) to ``action`` (n, 9), float32.

    A policy with memory has a ``state`` (n, S) as well, and gives ``next_state``; see
    :class:`fpg_bench.training.actor.Actor`. Layers of a user's own are read by PyTorch's exporter.

    Raises:
        UserError: a policy of another kind, or one that the versions at hand can't write as ONNX.
    """
    actor = Actor(model)
    plain = plain_onnx(actor)
    return _by_exporter(type(model.policy).__name__, actor) if plain is None else plain


def _by_exporter(kind: str, actor: Actor) -> bytes:
    """The ONNX of an actor, made of a policy of this kind, by PyTorch's exporter."""
    _keep_tqdm_in_this_process()
    examples = [torch.zeros(2, OBSERVATION_SIZE)]
    names = ["observation", "action"]
    if actor.state_size:
        examples.append(torch.zeros(2, actor.state_size))
        names += ["state", "next_state"]
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        logging.getLogger("onnxscript").setLevel(logging.ERROR)
        path = Path(folder) / "policy.onnx"
        try:
            torch.onnx.export(
                actor,
                tuple(examples),
                str(path),
                input_names=names[::2],
                output_names=names[1::2],
                dynamic_shapes=tuple({0: torch.export.Dim("n")} for _ in examples),
                opset_version=OPSET,
                dynamo=True,
                external_data=False,
                verbose=False,
            )
        except Exception as error:  # the exporters have many kinds, none documented
            at_hand = ", ".join(f"{name} {version(name)}" for name in ("torch", "onnx", "onnxscript"))
            raise UserError(
                f"export: {kind} can't be written as ONNX by {at_hand}: {reason(error)}"
            ) from error
        finally:
            Distribution.set_default_validate_args(True)  # the exporter turns torch's checks off
        return stripped(path.read_bytes())


def _keep_tqdm_in_this_process() -> None:
    """Give tqdm a lock of threads; its own is one of processes, which a worker that is stopped leaves behind.

    The exporter makes a bar, hidden, where tqdm is installed.
    """
    with contextlib.suppress(ImportError):
        from tqdm import tqdm

        tqdm.set_lock(threading.RLock())


def export_agent(
    model: BaseAlgorithm,
    folder: str | os.PathLike[str],
    *,
    training_seed: int,
    id: str | None = None,
    algorithm: str | None = None,
    **about: Any,
) -> float:
    """Write a trained model as an agent folder: ``policy.onnx`` and ``agent.json``.

    Its ``VecNormalize`` and stacked frames are folded in; nothing is pickled.

    Args:
        model: a trained model of PPO's, SAC's or TD3's kind, with or without an LSTM.
        folder: where to, for a submission ``<submission>/seed_<training seed>``.
        training_seed: which of your training runs this is.
        id: the environment id; None: that of the model's games, made by :func:`fpg_bench.make_sb3`.
        algorithm: what it is called; None: the model's class.
        **about: what else ``agent.json`` is to say.

    Returns:
        The largest difference of any action to the model's own ``predict``.

    Raises:
        UserError: a policy of another kind, or games of another making and no ``id``.
    """
    env = model.get_env()
    games = None if env is None else env.unwrapped
    known = games if isinstance(games, SB3View) else None
    if id is None and known is None:
        raise UserError("export: the model has no games of fpg_bench.make_sb3; say which id it is for")
    told = {
        "algorithm": algorithm or type(model).__name__.lower(),
        "id": id or known.core.view.id,  # type: ignore[union-attr]
        "scenario": STANDARD.hash if known is None else known.core.scenario.hash,
        "training_seed": training_seed,
        "training_steps": model.num_timesteps,
    }
    return write_exported(model, Path(folder), told | about)


def write_exported(model: BaseAlgorithm, folder: Path, about: dict[str, Any]) -> float:
    """Write an agent folder: ``policy.onnx`` and ``agent.json``.

    Args:
        model: a trained model (with its ``VecNormalize`` and stacked frames, if it was trained with them).
        folder: where to.
        about: what ``agent.json`` says: algorithm, id, scenario hash, training seed and steps, versions.

    Returns:
        The largest difference to the model's own ``predict``.

    Raises:
        UserError: a policy of another kind, or one that plays differently once exported.
    """
    data = export_onnx(model)
    about = {"format": AGENT_FORMAT, **about, "policy_sha256": hashlib.sha256(data).hexdigest()}
    difference = _checked(largest_difference(model, OnnxPlayer(data, about)), model)
    write_whole(folder / "policy.onnx", data)
    write_json(folder / "agent.json", about | {"largest_difference": difference})
    return difference


def check_exportable(model: BaseAlgorithm) -> None:
    """Raise UserError where the model's policy could not be exported once it is trained."""
    _checked(largest_difference(model, OnnxPlayer(export_onnx(model), {}), steps=20), model)


def _checked(difference: float, model: BaseAlgorithm) -> float:
    if not difference <= GREATEST_DIFFERENCE:
        kind = type(model.policy).__name__
        raise UserError(
            f"export: the exported policy differs from predict by {difference:g}, more than "
            f"{GREATEST_DIFFERENCE:g}: {kind} computes more than its networks say"
        )
    return difference


def largest_difference(model: BaseAlgorithm, player: Any, steps: int = 200, games: int = 5) -> float:
    """The largest difference of any action entry between the model and a player, over rounds that restart.

    Args:
        model: its ``predict`` is handed what it was trained on: stacked and normalised observations.
        player: is handed the observations themselves, uniformly random.
        steps: steps of each game.
        games: games at once; each restarts every twenty steps on average.
    """
    rng, normalize = np.random.default_rng(0), model.get_vec_normalize_env()
    stack = np.zeros((games, *cast(tuple[int, ...], model.observation_space.shape)), np.float32)
    theirs_memory = ours_memory = None
    starts, worst = np.ones(games, bool), 0.0
    for _ in range(steps):
        observation = rng.uniform(-1, 1, (games, OBSERVATION_SIZE)).astype(np.float32)
        stack[starts] = 0
        stack = np.concatenate((stack[:, OBSERVATION_SIZE:], observation), axis=1)
        seen = stack if normalize is None else normalize.normalize_obs(stack.copy())
        theirs, theirs_memory = model.predict(cast(np.ndarray, seen), theirs_memory, starts, True)
        ours, ours_memory = player.predict(observation, ours_memory, starts)
        worst = np.maximum(worst, np.abs(theirs - ours).max())
        starts = rng.random(games) < 0.05
    return float(worst)
