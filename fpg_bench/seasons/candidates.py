"""Training a candidate from its recipe: small networks, short budgets, the same agent for the same recipe."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from fpg_bench.ids import policy_view
from fpg_bench.seasons.recipe import Recipe
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.spec import RunSpec
from fpg_bench.training.train import train_run

_PPO = {
    "policy": "MlpPolicy",
    "n_envs": 128,
    "n_steps": 64,
    "batch_size": 4096,
    "n_epochs": 4,
    "learning_rate": 0.002,
    "gae_lambda": 0.8,
    "normalize": {"norm_obs": False, "norm_reward": True},
}
_TD3 = {
    "policy": "MlpPolicy",
    "n_envs": 8,
    "learning_starts": 2000,
    "buffer_size": 100_000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 1,
    "learning_rate": 0.002,
    "tau": 0.01,
    "noise_type": "normal",
    "noise_std": 0.1,
    "normalize": {"norm_obs": False, "norm_reward": True},
}


def hyperparameters(recipe: Recipe) -> dict[str, Any]:
    """Those of a recipe, as :class:`fpg_bench.training.spec.RunSpec` takes them."""
    networks: dict[str, Any] = {"net_arch": [64, 64]}
    own: dict[str, Any] = {"n_timesteps": recipe.steps, "gamma": recipe.gamma, "policy_kwargs": networks}
    if recipe.algorithm == "td3":
        networks["optimizer_kwargs"] = {"fused": True}
        return _TD3 | own
    networks |= {"activation_fn": "ReLU", "log_std_init": recipe.log_std}
    return _PPO | own


def train_candidate(recipe: Recipe, folder: Path) -> None:
    """Train a candidate, and drop what a finished run needs no more: the model, its log and its checkpoints.

    An unfinished one is begun again, so that the result is always the same.

    Args:
        recipe: how.
        folder: of its run; a finished one is not trained again.

    Raises:
        UserError: the folder holds an unfinished run of another kind, or training diverged.
    """
    run = RunSpec(
        recipe.algorithm,
        policy_view(recipe.side).id,
        recipe.training_seed,
        recipe.steps,
        hyperparameters(recipe),
        against=list(recipe.targets),
        options={"reward": recipe.reward, "path": recipe.path},
    )
    if not RunFolder(folder).is_finished():
        train_run(run, folder, evaluations=0, progress=False, restart=True)
    for path in folder.iterdir():
        if path.name not in ("agent", "run.json", "evaluations.jsonl"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
