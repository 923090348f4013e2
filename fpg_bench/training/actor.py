"""The deterministic policy of an SB3 model as one module: normalisation, memory, networks, squashing."""

from __future__ import annotations

import copy
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from torch import nn

from fpg_bench.errors import UserError
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.players.keyed import Batched

Networks = tuple[nn.Module, nn.LSTM | None, nn.Module]


class Actor(nn.Module):
    """What ``predict`` computes, from ``observation`` (n, 15) and a flat ``state`` (n, S).

    The state is empty at a round's start (zeros) and holds the last k - 1 observations, the oldest first,
    where frames are stacked; then the hidden and the cell state of an LSTM, layer by layer.

    Args:
        model: a trained model; its present weights are copied.

    Raises:
        UserError: a policy of another kind.
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        super().__init__()
        policy = model.policy
        self.features, self.lstm, self.networks = copy.deepcopy(_networks(policy))
        # TD3's networks end in a tanh of their own.
        own_tanh = not isinstance(policy, ActorCriticPolicy) and not hasattr(_actor(policy), "latent_pi")
        self.squash = bool(policy.squash_output) and not own_tanh
        self._normalise_as(model)
        self.frames_size = cast(tuple[int, ...], model.observation_space.shape)[0] - OBSERVATION_SIZE
        self.state_size = self.frames_size
        if self.lstm is not None:
            self.state_size += 2 * self.lstm.num_layers * self.lstm.hidden_size
        self.cpu().eval()

    def _normalise_as(self, model: BaseAlgorithm) -> None:
        normalize = model.get_vec_normalize_env()
        mean: np.ndarray = np.zeros(1)
        scale: np.ndarray = np.ones(1)
        self.clip = np.inf
        if normalize is not None and normalize.norm_obs:
            statistics = cast(RunningMeanStd, normalize.obs_rms)
            mean, scale = statistics.mean, np.sqrt(statistics.var + normalize.epsilon)
            self.clip = float(normalize.clip_obs)
        self.mean = nn.Buffer(torch.as_tensor(mean, dtype=torch.float32))
        self.scale = nn.Buffer(torch.as_tensor(scale, dtype=torch.float32))

    def forward(self, observation: torch.Tensor, state: torch.Tensor | None = None) -> Any:
        """The action (n, 9); with a state, the next state as well."""
        if state is None:
            return self._action(self.features(self._normalised(observation)))
        seen = torch.cat((state[:, : self.frames_size], observation), 1)
        latent = self.features(self._normalised(seen))
        kept = [seen[:, OBSERVATION_SIZE:]]
        if self.lstm is not None:
            latent, memory = self._remember(latent, state[:, self.frames_size :])
            kept.append(memory)
        return self._action(latent), torch.cat(kept, 1)

    def _normalised(self, seen: torch.Tensor) -> torch.Tensor:
        if not np.isfinite(self.clip):
            return seen
        return ((seen - self.mean) / self.scale).clamp(-self.clip, self.clip)

    def _remember(self, latent: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        assert self.lstm is not None
        parts = memory.reshape(-1, 2, self.lstm.num_layers, self.lstm.hidden_size).permute(1, 2, 0, 3)
        out, states = self.lstm(latent.unsqueeze(0), (parts[0].contiguous(), parts[1].contiguous()))
        flat = torch.stack(states).permute(2, 0, 1, 3).flatten(1)
        return out.squeeze(0), flat

    def _action(self, latent: torch.Tensor) -> torch.Tensor:
        action = self.networks(latent)
        return torch.tanh(action) if self.squash else action.clamp(-1.0, 1.0)


def _networks(policy: Any) -> Networks:
    """What comes before an LSTM, the LSTM if there is one, and what follows, as SB3 chains them."""
    if isinstance(policy, ActorCriticPolicy):
        after = nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
        return policy.pi_features_extractor, _lstm(policy), after
    actor = _actor(policy)
    if isinstance(getattr(actor, "mu", None), nn.Module):  # SAC's kind has networks before the mean
        layers = [getattr(actor, "latent_pi", nn.Identity()), actor.mu]
        return actor.features_extractor, None, nn.Sequential(*layers)
    raise UserError(
        f"export: {type(policy).__name__} is no policy of PPO's, SAC's or TD3's kind in torch, so no "
        "agent can be made of it; train it with its own learn() on fpg_bench.make_sb3, write its network as "
        "ONNX, and make an agent of that by fpg_bench.write_agent"
    )


def _actor(policy: Any) -> Any:
    """The actor of a policy of SAC's and TD3's kind; MADDPG's are actors themselves."""
    return getattr(policy, "actor", policy)


def _lstm(policy: nn.Module) -> nn.LSTM | None:
    lstm = getattr(policy, "lstm_actor", None)
    if lstm is not None and (lstm.bidirectional or lstm.proj_size or lstm.batch_first):
        raise UserError(
            "export: lstm_kwargs: an LSTM with bidirectional, proj_size or batch_first can't be exported"
        )
    return lstm


class ActorPlayer(Batched):
    """Plays a model's present policy through torch, as its exported agent will.

    Args:
        model: a model of Stable-Baselines3; its present weights are copied.

    Raises:
        UserError: a policy of another kind.
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        self._actor = Actor(model)

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        observation = torch.from_numpy(np.array(seen, np.float32))
        with torch.inference_mode():
            if not self._actor.state_size:
                return self._actor(observation).numpy(), None
            memory = torch.zeros(len(observation), self._actor.state_size) if state is None else state.clone()
            if starts is not None:
                memory[torch.from_numpy(starts)] = 0
            action, memory = self._actor(observation, memory)
        return action.numpy(), memory
