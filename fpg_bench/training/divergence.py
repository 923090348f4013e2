"""Training that diverges: how the weights, torch and the games tell."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.game.arena import ActionError


def tells_divergence(error: Exception, sides: Sequence[str]) -> bool:
    """Whether an error is one that a policy without usable numbers leads to.

    Either an action of a side that learns is NaN, or torch refuses the parameters of the distribution that
    actions are drawn from: a mean that is NaN, or a standard deviation that fell to 0, which can happen while
    all weights are finite.

    Args:
        error: what stopped the training.
        sides: those that learn.
    """
    own_action = isinstance(error, ActionError) and str(error).startswith(tuple(sides))
    return own_action or "found invalid values" in str(error)


def is_finite(model: BaseAlgorithm) -> bool:
    """Whether all weights of a model's policy are finite."""
    return all(bool(torch.isfinite(weights).all()) for weights in model.policy.parameters())
