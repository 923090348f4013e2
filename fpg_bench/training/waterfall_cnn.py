"""Convolutional features of a spectrum waterfall."""

from __future__ import annotations

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn


class WaterfallCNN(BaseFeaturesExtractor):
    """Two convolutions over history and frequency, and a linear layer, each followed by a ReLU.

    In a hyper-parameter file: ``policy_kwargs: {features_extractor_class:
    "fpg_bench.training.waterfall_cnn:WaterfallCNN"}``.

    Args:
        observation_space: ``Box`` of shape (history, bins).
        features_dim: number of features.
    """

    def __init__(self, observation_space: spaces.Box, features_dim: int = 128) -> None:
        super().__init__(observation_space, features_dim)
        convolutions = nn.Sequential(
            nn.Conv2d(1, 16, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, 32, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
        )
        size = convolutions(torch.zeros(1, 1, *observation_space.shape)).shape[1]
        self.layers = nn.Sequential(convolutions, nn.Linear(size, features_dim), nn.ReLU())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the features ``(n, features_dim)`` of waterfalls ``(n, history, bins)``."""
        features: torch.Tensor = self.layers(observations.unsqueeze(1))
        return features
