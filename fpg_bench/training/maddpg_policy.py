"""MADDPG's networks: all players' actors, and a critic of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy, ContinuousCritic
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.td3.policies import Actor
from torch import nn

from fpg_bench.training.maddpg_learner import Sizes, each_its_own


class JointPolicy(BasePolicy):
    """All players' actors, and a critic of each that sees what all of them see and do.

    Args:
        observation_space, action_space: of all players, one after the other; boxes.
        lr_schedule: the learning rate.
        sizes: of each player's observation and action.
        net_arch: the hidden layers of all networks.
        activation_fn: between them.
        optimizer_class, optimizer_kwargs: one optimiser for all actors, one for all critics.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        lr_schedule: Callable[[float], float],
        sizes: Sizes,
        net_arch: list[int] | None = None,
        activation_fn: type[nn.Module] = nn.ReLU,
        optimizer_class: type[torch.optim.Optimizer] = torch.optim.Adam,
        optimizer_kwargs: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(
            observation_space,
            action_space,
            optimizer_class=optimizer_class,
            optimizer_kwargs=optimizer_kwargs,
            squash_output=True,
        )
        self.sizes: Sizes = tuple((seen, acts) for seen, acts in sizes)
        self.net_arch, self.activation_fn = net_arch or [64, 64], activation_fn
        own = list(
            zip(*map(_parts, (observation_space, action_space), zip(*sizes, strict=True)), strict=True)
        )
        joint = [(observation_space, action_space)] * len(sizes)
        self.actors, self.actor_targets = (self._each(Actor, own) for _ in range(2))
        self.critics, self.critic_targets = (
            self._each(ContinuousCritic, joint, n_critics=1) for _ in range(2)
        )
        for networks, targets in ((self.actors, self.actor_targets), (self.critics, self.critic_targets)):
            targets.load_state_dict(networks.state_dict())
        rate = {"lr": lr_schedule(1), **self.optimizer_kwargs}
        self.actor_optimizer = self.optimizer_class(self.actors.parameters(), **rate)
        self.critic_optimizer = self.optimizer_class(self.critics.parameters(), **rate)

    def _each(
        self, kind: Callable[..., nn.Module], spaces_of: list[tuple[spaces.Box, spaces.Box]], **more: Any
    ) -> nn.ModuleList:
        """One network for each player, by the spaces of what it sees and of what is done."""
        arguments: dict[str, Any] = {"net_arch": self.net_arch, "activation_fn": self.activation_fn, **more}
        return nn.ModuleList(
            kind(
                observation_space=seen,
                action_space=acts,
                features_extractor=FlattenExtractor(seen),
                features_dim=seen.shape[0],
                **arguments,
            )
            for seen, acts in spaces_of
        )

    def set_training_mode(self, mode: bool) -> None:
        """As SB3's, which walks through all networks at every step even where nothing changes."""
        if mode != self.training:
            super().set_training_mode(mode)

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # type: ignore[override]
        return torch.cat(each_its_own(self.sizes, list(self.actors), observation), 1)

    def forward(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        """All players' actions in [-1, 1]."""
        return self._predict(observation, deterministic)


def _parts(space: spaces.Box, sizes: Sequence[int]) -> list[spaces.Box]:
    """Each player's part of a box that holds all of them one after the other."""
    ends = np.cumsum(sizes)[:-1]
    return [
        spaces.Box(low, high)
        for low, high in zip(np.split(space.low, ends), np.split(space.high, ends), strict=True)
    ]
