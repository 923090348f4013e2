"""Policy of MADDPG: the actors of all players, and a critic of each."""

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

Sizes = tuple[tuple[int, int], ...]  # observation and action size of each player


class JointPolicy(BasePolicy):
    """Actors of all players, and for each a critic that sees all observations and actions.

    Args:
        observation_space, action_space: boxes of all players' spaces, concatenated.
        lr_schedule: the learning rate.
        sizes: observation and action size of each player.
        net_arch: hidden layers of all networks.
        activation_fn: activation between the layers.
        optimizer_class, optimizer_kwargs: one optimizer for all actors, one for all critics.
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
        self.sizes: Sizes = tuple((obs_size, action_size) for obs_size, action_size in sizes)
        self.net_arch, self.activation_fn = net_arch or [64, 64], activation_fn
        obs_sizes, action_sizes = zip(*sizes, strict=True)
        own = list(
            zip(_split_box(observation_space, obs_sizes), _split_box(action_space, action_sizes), strict=True)
        )
        joint = [(observation_space, action_space)] * len(sizes)
        self.actors, self.actor_targets = (self._networks(Actor, own) for _ in range(2))
        self.critics, self.critic_targets = (
            self._networks(ContinuousCritic, joint, n_critics=1) for _ in range(2)
        )
        for networks, targets in ((self.actors, self.actor_targets), (self.critics, self.critic_targets)):
            targets.load_state_dict(networks.state_dict())
        optimizer = {"lr": lr_schedule(1), **self.optimizer_kwargs}
        self.actor_optimizer = self.optimizer_class(self.actors.parameters(), **optimizer)
        self.critic_optimizer = self.optimizer_class(self.critics.parameters(), **optimizer)

    def _networks(
        self,
        kind: Callable[..., nn.Module],
        player_spaces: list[tuple[spaces.Box, spaces.Box]],
        **kwargs: int,
    ) -> nn.ModuleList:
        """Return a network for each player, from its observation and action space."""
        return nn.ModuleList(
            kind(
                observation_space=obs_space,
                action_space=action_space,
                features_extractor=FlattenExtractor(obs_space),
                features_dim=obs_space.shape[0],
                net_arch=self.net_arch,
                activation_fn=self.activation_fn,
                **kwargs,
            )
            for obs_space, action_space in player_spaces
        )

    def set_training_mode(self, mode: bool) -> None:
        """Set the training mode; SB3's own walks through all networks even without a change."""
        if mode != self.training:
            super().set_training_mode(mode)

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # type: ignore[override]
        return torch.cat(act_separately(self.sizes, list(self.actors), observation), 1)

    def forward(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        """Return all players' actions in [-1, 1], ``(n, all)``."""
        return self._predict(observation, deterministic)


def act_separately(
    sizes: Sizes, actors: Sequence[Callable[[torch.Tensor], torch.Tensor]], obs: torch.Tensor
) -> list[torch.Tensor]:
    """Return each actor's output for its own part of the observations ``(n, all)``."""
    parts = torch.split(obs, [obs_size for obs_size, _ in sizes], dim=-1)
    return [actor(part) for actor, part in zip(actors, parts, strict=True)]


def _split_box(space: spaces.Box, sizes: Sequence[int]) -> list[spaces.Box]:
    """Split a box into the players' parts."""
    ends = np.cumsum(sizes)[:-1]
    return [
        spaces.Box(low, high)
        for low, high in zip(np.split(space.low, ends), np.split(space.high, ends), strict=True)
    ]
