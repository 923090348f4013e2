"""From a model of Stable-Baselines3 in your own program to an agent folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.envs.sb3 import SB3View
from fpg_bench.errors import UserError
from fpg_bench.game.scenario import STANDARD
from fpg_bench.training import export


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
    return export.export_agent(model, Path(folder), told | about)
