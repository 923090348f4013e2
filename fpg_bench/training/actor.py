"""Parts of the policy of an SB3 model: normalization, memory, networks, and squashing or sampling."""

from __future__ import annotations

import functools
import math
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from sb3_contrib.qrdqn.policies import QRDQNPolicy
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.dqn.policies import DQNPolicy
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import action_space
from fpg_bench.game.choices import Choices
from fpg_bench.game.spec import OtherGame
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.game.waterfall import Waterfall
from fpg_bench.players.memory import MEMORY_SIZES
from fpg_bench.players.preprocessing import core_of, preprocessing_of

FORBIDDEN = np.float32(-1e30)  # value of a forbidden choice
Networks = tuple[nn.Module, nn.LSTM | None, nn.Module]


class Normalization:
    """The numbers of ``VecNormalize.normalize_obs``, in float32."""

    def __init__(self, normalize: VecNormalize) -> None:
        statistics = cast(RunningMeanStd, normalize.obs_rms)
        self.mean = np.asarray(statistics.mean, np.float32).ravel()
        self.scale = np.asarray(np.sqrt(statistics.var + normalize.epsilon), np.float32).ravel()
        self.clip = float(normalize.clip_obs)


class Actor:
    """Parts of ``predict``, from ``observation`` (n, size), a flat ``state`` (n, S) and ``noise``.

    The state is zero at the start of a round. With stacked frames it holds the last k - 1 observations, or
    rows of a waterfall, oldest first; then come what :func:`fpg_bench.players.memory.remember` returns, and
    the hidden and the cell state of an LSTM, layer by layer.
    Of the ``noise``, one number is for choices with a drawn point; behind it a policy that samples draws each
    choice from its probabilities by one number, or the nine floats from their normal distributions.

    Args:
        model: a trained model; its weights are not copied.
        choices: the choices of a discrete model; None takes those of its games.
        samples: whether it draws its actions, as a seat of a team does; None: as the model's games say.
        game: the game of a model without games, if it is not the duel.

    Attributes:
        choices: None where actions are continuous.
        waterfall: None where the policy sees the 15 numbers.
        before, after: normalizations, of each frame before it is stacked and of the whole stack.
        features, lstm, networks: the networks before an LSTM, the LSTM or None, and those after it.
        memory: the side whose memory follows the frames; empty for none.
        frame_size, frames_size, past_size: size of one frame, of all frames in the state, and of these with
            the memory.
        penalty: ``(choices,)`` float32, added to the values of the choices so that no forbidden one is best.
        size: how many numbers it observes.
        samples: true if it draws its actions.
        noise_size: how many numbers of ``noise`` it needs.

    Raises:
        UserError: an unsupported policy, or one with another list of choices.
    """

    def __init__(
        self,
        model: BaseAlgorithm,
        choices: Choices | None = None,
        samples: bool | None = None,
        game: OtherGame | None = None,
    ) -> None:
        policy = model.policy
        self.choices = _choices(model, choices)
        if self.choices is not None:
            self.penalty = np.where(self.choices.mask, np.float32(0), FORBIDDEN)
        self.samples = getattr(core_of(model) or game, "samples", False) if samples is None else samples
        self.noise_size = int(self.choices is not None and self.choices.is_drawn)
        if self.samples:
            self.noise_size += ACTION_SIZE if self.choices is None else len(self.choices.sizes)
            self.deviation = _deviation(policy)
        self.features, self.lstm, self.networks = _networks(policy)
        # TD3's networks already end in a tanh.
        has_tanh = not isinstance(policy, ActorCriticPolicy) and not hasattr(_actor(policy), "latent_pi")
        self.squash = self.choices is None and bool(policy.squash_output) and not has_tanh
        self.waterfall = waterfall_of(model)
        preprocessing = preprocessing_of(model, self.waterfall, game)
        self.before = [Normalization(each) for each in preprocessing.before]
        self.after = [Normalization(each) for each in preprocessing.after]
        self.size = preprocessing.size
        self.frame_size = self.size if self.waterfall is None else self.waterfall.shape[1]
        self.memory = preprocessing.memory
        self.past_size = math.prod(cast(tuple[int, ...], model.observation_space.shape)) - self.frame_size
        self.frames_size = self.past_size - MEMORY_SIZES.get(self.memory, 0)
        self.state_size = self.past_size
        if self.lstm is not None:
            self.state_size += 2 * self.lstm.num_layers * self.lstm.hidden_size


def _deviation(policy: BasePolicy) -> torch.Tensor:
    """Return the deviations of a policy's actions, ``(9,)``; of choices nothing.

    Raises:
        UserError: the policy has no distribution of its own.
    """
    has_own = isinstance(policy, ActorCriticPolicy | MaskableActorCriticPolicy)
    if not has_own or getattr(policy, "use_sde", False):
        raise UserError(
            "export: seats of a team draw their actions from a distribution, which "
            f"{type(policy).__name__} lacks; train ppo, maskable-ppo or recurrent-ppo, without use_sde"
        )
    log_std = getattr(policy, "log_std", None)
    return torch.zeros(0) if log_std is None else log_std.detach().exp()


def waterfall_of(model: BaseAlgorithm) -> Waterfall | None:
    """Return the waterfall that a model observes; None for a model of the 15 numbers, stacked or not.

    Raises:
        UserError: the model observes a waterfall but has no games.
    """
    shape = cast(tuple[int, ...], model.observation_space.shape)
    if len(shape) == 1:
        return None
    if (core := core_of(model)) is None:
        raise UserError(
            f"the model observes {model.observation_space}, not the waterfall of its games; give it games of "
            "fpg_bench with set_env"
        )
    waterfall: Waterfall | None = getattr(core, "waterfall", None)
    return waterfall


def _choices(model: BaseAlgorithm, choices: Choices | None) -> Choices | None:
    """Return the choices of a model, from its games if not given; None for continuous actions.

    Raises:
        UserError: the model has another list of choices, or discrete actions and no games.
    """
    space = model.policy.action_space
    if isinstance(space, spaces.Box):
        return None
    choices = choices or getattr(core_of(model), "choices", None)
    if choices is None:
        raise UserError(
            f"the model chooses from {space} but has no games that define the choices; name its id"
        )
    if space != action_space(choices):
        raise UserError(
            f"the model chooses from {space}, the {choices.side} from {action_space(choices)} "
            f"(actions={choices.mode!r})"
        )
    return choices


def _networks(policy: BasePolicy) -> Networks:
    """Return the networks before an LSTM, the LSTM or None, and the networks after it, as SB3 chains them."""
    if isinstance(policy, ActorCriticPolicy | MaskableActorCriticPolicy):
        networks = nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
        return policy.pi_features_extractor, _lstm(policy), networks
    if isinstance(policy, DQNPolicy):
        return policy.q_net.features_extractor, None, policy.q_net.q_net
    if isinstance(policy, QRDQNPolicy):
        return policy.quantile_net.features_extractor, None, _mean_of_quantiles(policy.quantile_net)
    actor = _actor(policy)
    if isinstance(getattr(actor, "mu", None), nn.Module):  # SAC and the like have networks before the mean
        layers = [getattr(actor, "latent_pi", nn.Identity()), actor.mu]
        return actor.features_extractor, None, nn.Sequential(*layers)
    raise UserError(
        f"export: {type(policy).__name__} is not a torch policy like those of PPO, DQN, SAC or TD3, so it "
        "cannot be exported; train it with its own learn() on fpg_bench.make_sb3, write its network as ONNX, "
        "and make an agent of that with fpg_bench.write_agent"
    )


def _mean_of_quantiles(network: Any) -> nn.Sequential:
    """Return QR-DQN's network with the mean over quantiles folded into its last layer, which is linear."""
    *layers, last = network.quantile_net
    mean = nn.Linear(last.in_features, last.out_features // network.n_quantiles)
    with torch.no_grad():
        for name in ("weight", "bias"):
            values = getattr(last, name)
            getattr(mean, name).copy_(values.view(network.n_quantiles, -1, *values.shape[1:]).mean(0))
    return nn.Sequential(*layers, mean)


def _actor(policy: BasePolicy) -> Any:
    """Return the actor of a policy such as SAC's or TD3's; MADDPG's policies are actors themselves."""
    return getattr(policy, "actor", policy)


def _lstm(policy: nn.Module) -> nn.LSTM | None:
    lstm = getattr(policy, "lstm_actor", None)
    if lstm is not None and (lstm.bidirectional or lstm.proj_size or lstm.batch_first):
        raise UserError(
            "export: lstm_kwargs: an LSTM with bidirectional, proj_size or batch_first can't be exported"
        )
    return lstm


def is_untouched(module: nn.Module) -> bool:
    """Return True if a module computes what its class does: without hooks and replaced methods."""
    has_hooks = module._forward_hooks or module._forward_pre_hooks
    has_hooks = has_hooks or module._backward_hooks or module._backward_pre_hooks
    kind: Any = type(module)
    return not has_hooks and _methods(kind).isdisjoint(vars(module))


@functools.cache
def _methods(kind: type[nn.Module]) -> frozenset[str]:
    return frozenset(name for name in dir(kind) if callable(getattr(kind, name)))
