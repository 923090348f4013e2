"""Algorithms of a user's own, as ``fpg-bench train tests.training.own:Class`` names them."""

from __future__ import annotations

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy

from fpg_bench import FastPPO


class Mine(PPO):
    """PPO with one number more."""

    def __init__(self, *args, bonus: float = 0.0, n_steps: int = 50, **kwargs):
        super().__init__(*args, n_steps=n_steps, batch_size=100, n_epochs=1, **kwargs)
        self.bonus = bonus


class Losing(FastPPO):
    """PPO whose policy is another after the training than it was in it."""

    def learn(self, *args, **kwargs):
        super().learn(*args, **kwargs)
        self.policy.action_net.weight.data *= -1
        self.policy.action_net.bias.data *= -1
        return self


class Doubling(ActorCriticPolicy):
    """A policy whose predict does more than its networks say."""

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        return 0.5 + super()._predict(observation, deterministic)


class Odd(PPO):
    """PPO with a policy that can't be exported."""

    policy_aliases = {"MlpPolicy": Doubling}  # noqa: RUF012


class Failing(PPO):
    """PPO that can't be made."""

    def __init__(self, *args, **kwargs):
        raise KeyError("its own reasons")


class NoAlgorithm:
    """Not of SB3's kind."""
