"""Training of several MADDPG seeds, by torch or by JAX."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import need
from fpg_bench.training.maddpg.maddpg import MADDPG

LEARNERS = ("torch", "jax")


def learn_seeds(models: Mapping[int, MADDPG], total_timesteps: int, learner: str = "torch") -> None:
    """Train models one after the other, each as if it were trained alone.

    Args:
        models: new models by their training seeds.
        total_timesteps: steps of each model.
        learner: ``torch``, or ``jax``, which is faster and needs the extra ``fast``. Both give the same
            weights apart from the rounding of sums.

    Raises:
        UserError: an unknown learner, or one whose packages are missing.
    """
    check_learner(learner)
    for seed, model in models.items():
        np.random.seed(seed)  # noqa: NPY002
        if learner == "torch":
            model.learn(total_timesteps)
        else:
            from fpg_bench.training.maddpg.jax_learner import JaxLearner

            JaxLearner(model).learn(total_timesteps)


def check_learner(name: str) -> None:
    """Raise UserError for an unknown learner, or one whose packages are missing."""
    if name not in LEARNERS:
        raise UserError(f"learner: expected torch or jax, got {name!r}{nearest(name, LEARNERS)}")
    if name == "jax":
        need("fast", "jax", "optax")
