"""Stable-Baselines3's PPO for small networks on a CPU, without autograd and the work of single steps."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import logging
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import (
    CategoricalDistribution,
    DiagGaussianDistribution,
    Distribution,
    MultiCategoricalDistribution,
)
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike
from stable_baselines3.common.torch_layers import FlattenExtractor, MlpExtractor
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from fpg_bench.training.actor import is_untouched

_logger = logging.getLogger(__name__)
_SAMPLES = ("observations", "actions", "values", "log_probs", "advantages", "returns")
_TOLERANCE = 1e-4  # of what the policy computes, relative to the largest of it
_ACTIVATIONS: dict[type[nn.Module], tuple[Any, Any]] = {  # in place, and the gradient before them
    nn.ReLU: (torch.relu_, lambda gradient, out: torch.ops.aten.threshold_backward(gradient, out, 0)),
    nn.Tanh: (torch.tanh_, torch.ops.aten.tanh_backward),
}
_KNOWN = {
    ActorCriticPolicy,
    FlattenExtractor,
    nn.Flatten,
    MlpExtractor,
    nn.Sequential,
    nn.Linear,
    *_ACTIVATIONS,
}
_OPTIMIZERS = {torch.optim.Adam, torch.optim.AdamW, torch.optim.SGD, torch.optim.RMSprop, RMSpropTFLike}


class FastPPO(PPO):
    """PPO that learns the same from the same random numbers, in about half the CPU time of small networks.

    Values and log-probabilities are computed once per rollout instead of at each step, gradients are written
    out instead of recorded, and Adam is fused. Arguments, callbacks, logs and saved models are those of PPO,
    and ``PPO.load`` opens them, too. While a rollout is collected, the callbacks' ``locals`` lack ``values``
    and ``log_probs``.

    It serves an ``MlpPolicy`` as SB3 builds it, of ReLU or Tanh and without ``use_sde``, on the CPU, with
    actions that are ``Box``, ``Discrete`` or ``MultiDiscrete``. Anything else, such as a CNN, dict
    observations, your own features extractor or a layer that was exchanged, is trained as PPO trains it, and
    a warning says so. PPO collects the first rollout of each ``learn``; if the policy computes other values,
    log-probabilities or entropies for it, PPO does the rest as well.

    >>> from fpg_bench import make_sb3
    >>> games = make_sb3("FPG/AllyVsScripted-v0", n_envs=4, seed=0)
    >>> FastPPO("MlpPolicy", games, n_steps=8, batch_size=16).learn(64).num_timesteps
    64
    """

    _agrees: bool | None = None  # with the policy, in this call of learn; None: not yet compared
    _told: str | None = None  # the reason of the last warning

    def _setup_model(self) -> None:
        super()._setup_model()
        self._is_served()

    def learn(self, *args: Any, **kwargs: Any) -> Any:
        """Train as PPO does, after a comparison with it; arguments are those of PPO."""
        self._agrees = None
        return super().learn(*args, **kwargs)

    def _is_served(self) -> bool:
        """Return False, and say why, if the work is left to PPO."""
        reason = self._unserved()
        if reason not in (None, self._told):
            _logger.warning(f"FastPPO: {reason}, so it trains as PPO does, no faster")
        self._told = reason
        return reason is None

    def _unserved(self) -> str | None:
        """Return what is left to PPO; None if there is nothing."""
        policy: Any = self.policy
        if self._agrees is False:
            return "the policy computes something else than its layers"
        if type(policy) is not ActorCriticPolicy:
            return f"the policy is {type(policy).__name__}"
        if others := [each for each in policy.modules() if not (type(each) in _KNOWN and is_untouched(each))]:
            return f"{type(others[0]).__name__} is a module of the policy that it does not know"
        distribution, _ = _HEADS.get(type(self.action_space), (None, None))
        for is_unserved, reason in (
            (policy.use_sde or policy.squash_output, "use_sde or squash_output is set"),
            (distribution is None, f"actions are {type(self.action_space).__name__}"),
            (type(policy.action_dist) is not distribution, "the action distribution is another"),
            (not _is_usual(policy), "the layers are not those of an MlpPolicy"),
            (type(self.rollout_buffer) is not RolloutBuffer, "the rollout buffer is another"),
            (
                type(policy.optimizer) not in _OPTIMIZERS,
                f"the optimizer is {type(policy.optimizer).__name__}",
            ),
            (_ids(_optimized(policy)) != _ids(policy.parameters()), "the optimizer has other weights"),
            (not all(map(_is_plain, policy.parameters())), "some weights are frozen, hooked or not float32"),
            (self.device.type != "cpu", f"the device is {self.device}"),
        ):
            if is_unserved:
                return reason
        return None

    def _compare(self) -> bool:
        """Return True if the networks compute what the policy does, of a rollout that PPO has collected."""
        buffer: Any = self.rollout_buffer
        policy: Any = self.policy
        seen = torch.from_numpy(buffer.swap_and_flatten(buffer.observations))
        actions = torch.from_numpy(buffer.swap_and_flatten(buffer.actions))
        taken = actions.long().flatten() if isinstance(self.action_space, spaces.Discrete) else actions
        (actor, critic), head = _networks(policy), self._head()
        with torch.no_grad():
            features = self._features(seen.numpy())
            log_probs = head.log_probs(actor.forward(features)[-1], actions.float())
            ours = critic.forward(features)[-1].flatten(), log_probs, head.entropy()
            values, log_probs, entropy = policy.evaluate_actions(seen, taken)
            theirs = values.flatten(), log_probs, entropy.mean()
        return all(
            bool((one - other).abs().max() <= _TOLERANCE * (1 + other.abs().max()))
            for one, other in zip(ours, theirs, strict=True)
        )

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Play and fill the buffer; returns False if a callback stopped it."""
        is_served = self._is_served()
        if not is_served or self._agrees is None:
            goes_on = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
            if is_served and goes_on:
                self._agrees = self._compare()
            return goes_on
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        networks, head = _networks(self.policy), self._head()
        space: Any = self.action_space
        new_obs: Any = self._last_obs
        outputs, ends = [], []
        for n_steps in range(n_rollout_steps):
            with torch.no_grad():
                outputs.append(networks[0].forward(self._features(new_obs))[-1])
                actions = head.sample(outputs[-1]).numpy().reshape(-1, *space.shape)
            clipped_actions = actions
            if isinstance(space, spaces.Box):
                clipped_actions = actions.clip(space.low, space.high)
            rollout_buffer.observations[n_steps] = new_obs.reshape(rollout_buffer.observations[0].shape)
            rollout_buffer.actions[n_steps] = actions.reshape(rollout_buffer.actions[0].shape)
            rollout_buffer.episode_starts[n_steps] = self._last_episode_starts
            new_obs, rewards, dones, infos = env.step(clipped_actions)
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            rollout_buffer.rewards[n_steps] = rewards
            over = np.flatnonzero(dones).tolist()
            self._update_info_buffer([infos[game] for game in over], dones[over])
            for game in over:
                last = infos[game].get("terminal_observation")
                if last is not None and infos[game].get("TimeLimit.truncated", False):
                    ends.append((n_steps, game, last))
            self._last_obs, self._last_episode_starts = new_obs, dones
        rollout_buffer.pos, rollout_buffer.full = n_rollout_steps, True
        last_values = self._evaluate(networks[1], head, torch.cat(outputs), ends)
        rollout_buffer.compute_returns_and_advantage(last_values, dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    @torch.no_grad()
    def _evaluate(
        self, critic: _Network, head: Any, outputs: torch.Tensor, ends: list[tuple[int, int, Any]]
    ) -> torch.Tensor:
        """Fill the rollout's values and log-probabilities; return the values of the observations after it.

        Args:
            critic, head: of the policy.
            outputs: of the actor.
            ends: step, environment and last observation where time alone ended an episode.
        """
        buffer: Any = self.rollout_buffer
        seen = self._features(buffer.observations.reshape(-1, *buffer.obs_shape))
        buffer.values[...] = critic.forward(seen)[-1].view(buffer.values.shape).numpy()
        log_probs = head.log_probs(outputs, torch.from_numpy(buffer.actions).flatten(0, 1))
        buffer.log_probs[...] = log_probs.view(buffer.values.shape).numpy()
        if ends:
            steps, games, last = zip(*ends, strict=True)
            values = critic.forward(self._features(np.stack(last)))[-1].numpy()
            buffer.rewards[list(steps), list(games)] += self.gamma * values[:, 0]
        return critic.forward(self._features(self._last_obs))[-1]

    def _features(self, observations: Any) -> torch.Tensor:
        """Return what the networks see of observations; without weights, both see the same."""
        seen = torch.from_numpy(observations)
        if seen.dtype == torch.float32 and seen.dim() == 2 and isinstance(self.observation_space, spaces.Box):
            return seen  # as it comes out below, sooner
        features = self.policy.extract_features(seen)
        return features if isinstance(features, torch.Tensor) else features[0]

    def _head(self) -> Any:
        return _HEADS[type(self.action_space)][1](self.policy, self.action_space)

    def train(self) -> None:
        """Update the policy from the buffer."""
        if self._is_served():
            self._train()
        else:
            super().train()

    @torch.no_grad()
    def _train(self) -> None:
        policy: Any = self.policy
        buffer: Any = self.rollout_buffer
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        if type(policy.optimizer) is torch.optim.Adam:
            for group in policy.optimizer.param_groups:
                group["fused"] = group["foreach"] is None
        remaining = self._current_progress_remaining
        clip_range = self.clip_range(remaining)  # type: ignore[operator]
        clip_range_vf = None if self.clip_range_vf is None else self.clip_range_vf(remaining)  # type: ignore[operator]
        actor, critic = _networks(policy)
        gradients = _flat_gradients(policy)
        flat = {name: buffer.swap_and_flatten(getattr(buffer, name)) for name in _SAMPLES}
        played = [self._features(flat.pop("observations")), torch.from_numpy(flat.pop("actions")).float()]
        games, numbers = torch.cat(played, 1), np.concatenate(list(flat.values()), 1).T
        cuts = range(0, len(games), self.batch_size)
        logged: list[tuple[float, ...]] = []
        stops = False
        for epoch in range(self.n_epochs):
            order = np.random.permutation(len(games))  # noqa: NPY002 - as SB3's buffer draws it
            shuffled, batches = numbers[:, order], games.index_select(0, torch.from_numpy(order))
            for cut in cuts:
                features, actions = batches[cut : cut + self.batch_size].tensor_split([played[0].shape[1]], 1)
                old_values, old_log_probs, advantages, returns = shuffled[:, cut : cut + self.batch_size]
                head, n = self._head(), len(features)
                if self.normalize_advantage and n > 1:
                    away = advantages - advantages.mean()
                    advantages = away / (math.sqrt(away @ away / (n - 1)) + 1e-8)
                layers, value_layers = actor.forward(features), critic.forward(features)
                log_ratio = head.log_probs(layers[-1], actions).numpy() - old_log_probs
                ratio = np.exp(log_ratio)
                gains = advantages * ratio
                least = np.minimum(gains, advantages * ratio.clip(1 - clip_range, 1 + clip_range))
                values = value_layers[-1].numpy()[:, 0]
                moved = values - old_values
                if clip_range_vf is not None:
                    values = old_values + moved.clip(-clip_range_vf, clip_range_vf)
                errors = values - returns
                kl = float((ratio - log_ratio).mean()) - 1
                fraction = np.count_nonzero(np.abs(ratio - 1) > clip_range) / n
                logged.append((-float(head.entropy()), -least.mean(), errors @ errors / n, kl, fraction))
                stops = self.target_kl is not None and kl > 1.5 * self.target_kl
                if stops:
                    break
                slope = gains * (gains <= least) / -n  # of the loss by each log-probability
                actor.backward(layers, head.gradient(torch.from_numpy(slope)[:, None], self.ent_coef))
                errors *= 2 * self.vf_coef / n
                if clip_range_vf is not None:
                    errors *= np.abs(moved) <= clip_range_vf
                critic.backward(value_layers, torch.from_numpy(errors)[:, None])
                norm = float(gradients.norm())
                if norm > self.max_grad_norm:
                    gradients *= self.max_grad_norm / (norm + 1e-6)
                policy.optimizer.step()
            self._n_updates += 1
            if stops:
                if self.verbose >= 1:
                    print(f"Early stopping at step {epoch} due to reaching max kl: {kl:.2f}")
                break
        self._log(np.array(logged), epoch * len(cuts), clip_range, clip_range_vf)

    def _log(
        self, losses: np.ndarray, last_epoch: int, clip_range: float, clip_range_vf: float | None
    ) -> None:
        entropy, gain, value, kl, clipped = losses.T
        buffer, log_std = self.rollout_buffer, getattr(self.policy, "log_std", None)
        for name, number in (
            ("entropy_loss", entropy.mean()),
            ("policy_gradient_loss", gain.mean()),
            ("value_loss", value.mean()),
            ("approx_kl", kl[last_epoch:].mean()),
            ("clip_fraction", clipped.mean()),
            ("loss", gain[-1] + self.ent_coef * entropy[-1] + self.vf_coef * value[-1]),
            ("explained_variance", explained_variance(buffer.values.flatten(), buffer.returns.flatten())),
            ("std", None if log_std is None else log_std.exp().mean().item()),
            ("clip_range", clip_range),
            ("clip_range_vf", clip_range_vf),
        ):
            if number is not None:
                self.logger.record(f"train/{name}", number)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")


def _flat_gradients(policy: ActorCriticPolicy) -> torch.Tensor:
    """Return one tensor of which all gradients are views."""
    weights = list(policy.parameters())
    gradients = torch.zeros(sum(weight.numel() for weight in weights))
    parts = torch.split(gradients, [weight.numel() for weight in weights])
    for weight, part in zip(weights, parts, strict=True):
        weight.grad = part.view_as(weight)
    return gradients


def _is_usual(policy: Any) -> bool:
    """Return True if a policy of known modules is chained as SB3 builds it, each weight used once."""
    extractors = (policy.features_extractor, policy.pi_features_extractor, policy.vf_features_extractor)
    if any(type(each) is not FlattenExtractor or not _flattens(each.flatten) for each in extractors):
        return False
    extractor, used = policy.mlp_extractor, [policy.log_std] if hasattr(policy, "log_std") else []
    if type(extractor) is not MlpExtractor:
        return False
    for hidden, last in ((extractor.policy_net, policy.action_net), (extractor.value_net, policy.value_net)):
        if type(hidden) is not nn.Sequential or len(hidden) % 2:
            return False
        modules: list[Any] = [*hidden, last]
        layers, kinds = modules[::2], {type(each) for each in modules[1::2]}
        if {type(layer) for layer in layers} != {nn.Linear} or len(kinds) > 1 or not kinds <= {*_ACTIVATIONS}:
            return False
        used += [weight for layer in layers for weight in (layer.weight, layer.bias)]
    return _ids(used) == _ids(policy.parameters())


def _flattens(layer: Any) -> bool:
    return type(layer) is nn.Flatten and (layer.start_dim, layer.end_dim) == (1, -1)


def _optimized(policy: Any) -> Iterator[torch.Tensor]:
    return (weight for group in policy.optimizer.param_groups for weight in group["params"])


def _ids(weights: Iterable[torch.Tensor]) -> list[int]:
    return sorted(map(id, weights))


def _is_plain(weight: Any) -> bool:
    hooks = weight._backward_hooks or weight._post_accumulate_grad_hooks
    return weight.requires_grad and weight.dtype == torch.float32 and not hooks


def _networks(policy: Any) -> tuple[_Network, _Network]:
    extractor = policy.mlp_extractor
    return _Network(extractor.policy_net, policy.action_net), _Network(extractor.value_net, policy.value_net)


class _Network:
    """Linear layers with an activation between them."""

    def __init__(self, hidden: Any, last: nn.Module) -> None:
        self._layers: list[Any] = [*hidden[::2], last]
        self._activate, self._through = _ACTIVATIONS[type(hidden[1]) if len(hidden) else nn.ReLU]

    def forward(self, features: torch.Tensor) -> list[torch.Tensor]:
        """Return the features and the outputs of each layer."""
        outputs = [features]
        for layer in self._layers:
            out = torch.addmm(layer.bias, outputs[-1], layer.weight.T)
            outputs.append(out if layer is self._layers[-1] else self._activate(out))
        return outputs

    def backward(self, outputs: list[torch.Tensor], gradient: torch.Tensor) -> None:
        """Set the gradients of the weights from that of the last layer's outputs."""
        for layer, seen in zip(reversed(self._layers), reversed(outputs[:-1]), strict=True):
            torch.mm(gradient.T, seen, out=layer.weight.grad)
            torch.sum(gradient, 0, out=layer.bias.grad)
            if layer is not self._layers[0]:
                gradient = self._through(gradient @ layer.weight, seen)


class _Normal:
    """Independent normal distributions around the actor's outputs."""

    def __init__(self, policy: Any, space: spaces.Box) -> None:
        self._log_std: Any = policy.log_std
        self._std: torch.Tensor = policy.log_std.detach().exp()
        self._entropy: torch.Tensor = self._log_std.detach().sum() + (
            0.5 + 0.5 * math.log(2 * math.pi)
        ) * len(self._std)

    def sample(self, means: torch.Tensor) -> torch.Tensor:
        return means + torch.randn_like(means) * self._std

    def log_probs(self, means: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        self._away: torch.Tensor = (actions - means) / self._std
        return self._away.square().sum(1).mul_(-0.5).sub_(self._entropy - 0.5 * len(self._std))

    def entropy(self) -> torch.Tensor:
        return self._entropy

    def gradient(self, slope: torch.Tensor, ent_coef: float) -> torch.Tensor:
        """Return the loss's gradient by the means, and set that by the deviations."""
        slopes = slope * self._away
        torch.sum(slopes.mul(self._away).sub_(slope), 0, out=self._log_std.grad)
        self._log_std.grad -= ent_coef
        return slopes.div_(self._std)


class _Choices:
    """Independent choices, whose logits are the actor's outputs."""

    def __init__(self, policy: Any, space: spaces.Discrete | spaces.MultiDiscrete) -> None:
        self._sizes = [int(space.n)] if isinstance(space, spaces.Discrete) else space.nvec.tolist()

    def sample(self, logits: torch.Tensor) -> torch.Tensor:
        return torch.cat([part.softmax(1).multinomial(1) for part in torch.split(logits, self._sizes, 1)], 1)

    def log_probs(self, logits: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        self._logs = [part.log_softmax(1) for part in torch.split(logits, self._sizes, 1)]
        self._taken = torch.split(actions.long(), 1, 1)
        taken = [logs.gather(1, each) for logs, each in zip(self._logs, self._taken, strict=True)]
        return torch.cat(taken, 1).sum(1)

    def entropy(self) -> torch.Tensor:
        self._entropies = [-(logs.exp() * logs).sum(1, keepdim=True) for logs in self._logs]
        return torch.cat(self._entropies, 1).sum(1).mean()

    def gradient(self, slope: torch.Tensor, ent_coef: float) -> torch.Tensor:
        """Return the loss's gradient by the logits."""
        parts = []
        for logs, taken, entropy in zip(self._logs, self._taken, self._entropies, strict=True):
            shares = logs.exp()
            part = shares * ((logs + entropy) * (ent_coef / len(slope)) - slope)
            parts.append(part.scatter_add_(1, taken, slope))
        return torch.cat(parts, 1)


_HEADS: dict[type[spaces.Space[Any]], tuple[type[Distribution], Any]] = {  # and the distribution of SB3
    spaces.Box: (DiagGaussianDistribution, _Normal),
    spaces.Discrete: (CategoricalDistribution, _Choices),
    spaces.MultiDiscrete: (MultiCategoricalDistribution, _Choices),
}
