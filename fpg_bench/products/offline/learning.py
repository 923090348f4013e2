"""Offline reinforcement learning: Stable-Baselines3 algorithms that learn only from a data set.

Networks, optimizers, files and export are those of SB3. A step is one gradient step; no game is played.

- ``bc``: behaviour cloning, and a critic of the behaviour's returns that PPO can start from.
- ``td3-bc``: Fujimoto & Gu, "A Minimalist Approach to Offline Reinforcement Learning" (NeurIPS 2021).
- ``cql``, ``discrete-cql``: Kumar et al., "Conservative Q-Learning for Offline Reinforcement Learning"
  (NeurIPS 2020), CQL(H) on SAC and on DQN.
- ``iql``: Kostrikov et al., "Offline Reinforcement Learning with Implicit Q-Learning" (ICLR 2022).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import DQN, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy, ContinuousCritic
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.type_aliases import RolloutReturn
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch.nn.functional import mse_loss, smooth_l1_loss

from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.training.imitation import actor_loss, discounted_returns

if TYPE_CHECKING:
    from fpg_bench.products.offline.read import Dataset

STEPS_AT_ONCE = 100  # between two calls of the callbacks
_GREATEST_WEIGHT = 100.0  # of an action in IQL's regression, as in its authors' code


class Batch(NamedTuple):
    """A batch of n transitions as tensors.

    Attributes:
        observations, next_observations: ``(n, size)`` float32, stacked and normalized.
        actions: ``(n, 9)`` float32, or ``(n,)`` int64 choices.
        rewards: ``(n, 1)`` float32, normalized.
        returns: ``(n, 1)`` float32, the behaviour's discounted return from here on.
    """

    observations: torch.Tensor
    actions: torch.Tensor
    next_observations: torch.Tensor
    rewards: torch.Tensor
    returns: torch.Tensor


class Transitions:
    """The transitions of whole rounds, to draw batches from.

    Rounds are truncated and never terminate, so all transitions bootstrap. The statistics of ``normalize``
    become those of the rounds.

    Args:
        observations: ``(N, T + 1, 15)`` float32.
        actions: ``(N, T, 9)`` float32, or ``(N, T)`` int64.
        rewards: ``(N, T)`` float32.
        gamma: discount factor.
        frames: number of stacked observations; those before the start of a round are zero.
        normalize: normalizes observations and rewards; None leaves them unchanged.
    """

    def __init__(
        self,
        observations: np.ndarray,
        actions: np.ndarray,
        rewards: np.ndarray,
        gamma: float,
        frames: int = 1,
        normalize: VecNormalize | None = None,
    ) -> None:
        self._observations = np.pad(observations, ((0, 0), (frames - 1, 0), (0, 0)))
        self._actions, self._normalize = actions, normalize
        self._window = np.arange(frames)
        if normalize is not None:
            rewards = self._normalized(normalize, rewards)
        self._rewards = rewards
        ends = np.zeros(rewards.T.shape, bool)
        ends[-1] = True
        self._returns = discounted_returns(rewards.T, ends, rewards[:, -1], gamma).T

    def sample(self, count: int) -> Batch:
        """Draw transitions with replacement, with NumPy's global generator like SB3's replay buffer."""
        rounds, steps = (np.random.randint(0, high, count) for high in self._rewards.shape)  # noqa: NPY002
        arrays = (
            self._seen(rounds, steps),
            self._actions[rounds, steps],
            self._seen(rounds, steps + 1),
            self._rewards[rounds, steps, None],
            self._returns[rounds, steps, None],
        )
        return Batch(*map(torch.as_tensor, arrays))

    def _seen(self, rounds: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return the policy's observations at these steps, oldest frame first."""
        frames = self._observations[rounds[:, None], steps[:, None] + self._window]
        stacked: np.ndarray = frames.reshape(len(rounds), -1)
        if self._normalize is not None:
            stacked = cast(np.ndarray, self._normalize.normalize_obs(stacked))
        return stacked

    def _normalized(self, normalize: VecNormalize, rewards: np.ndarray) -> np.ndarray:
        """Return the normalized rewards; the statistics are updated step by step, as in play."""
        self._normalize = None
        every, returns = np.arange(len(rewards)), np.zeros(len(rewards))
        for step in range(rewards.shape[1]):
            if normalize.norm_obs:
                cast(RunningMeanStd, normalize.obs_rms).update(self._seen(every, np.full(len(every), step)))
            returns = returns * normalize.gamma + rewards[:, step]
            normalize.ret_rms.update(returns)
        normalize.training = False
        self._normalize = normalize
        return normalize.normalize_reward(rewards).astype(np.float32)


class OfflineAlgorithm(OffPolicyAlgorithm):
    """Base class: ``learn`` makes gradient steps on batches of :attr:`data` and plays no game.

    Attributes:
        modes: the action modes that it learns.
        data: the transitions; :meth:`learn_from` sets them before ``learn``.
    """

    modes: ClassVar[tuple[str, ...]] = ("continuous",)

    data: Transitions

    def __init__(self, policy: Any, env: Any, **arguments: Any) -> None:
        super().__init__(policy, env, buffer_size=1, learning_starts=0, gradient_steps=-1, **arguments)

    def learn_from(self, dataset: Dataset, frames: int = 1) -> None:
        """Take the transitions of a data set.

        Args:
            dataset: the data set.
            frames: number of stacked observations.
        """
        self.data = Transitions(*dataset.read(), self.gamma, frames, self.get_vec_normalize_env())

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, *arguments: Any, **options: Any
    ) -> RolloutReturn:
        """Count the gradient steps that ``train`` makes next, and call the callbacks."""
        callback.on_rollout_start()
        steps = min(STEPS_AT_ONCE, self._total_timesteps - self.num_timesteps)
        self.num_timesteps += steps
        self._update_current_progress_remaining(self.num_timesteps, self._total_timesteps)
        callback.on_step()
        callback.on_rollout_end()
        return RolloutReturn(steps, 0, True)

    def train(self, gradient_steps: int, batch_size: int = 256) -> None:
        """Make gradient steps, and log the means of their losses."""
        self.policy.set_training_mode(True)
        names = [name for name in self._get_torch_save_params()[0] if name.endswith("optimizer")]
        self._update_learning_rate([recursive_getattr(self, name) for name in names])
        losses = []
        for _ in range(gradient_steps):
            self._n_updates += 1
            losses.append(self._update(self.data.sample(batch_size)))
        for name in losses[-1]:
            values = [each[name] for each in losses if name in each]
            self.logger.record(f"train/{name}", float(np.mean(values)))
        self.logger.dump(self.num_timesteps)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "data"]

    @abstractmethod
    def _update(self, batch: Batch) -> dict[str, float]:
        """Make one gradient step; returns its losses by name."""


class TD3BC(OfflineAlgorithm, TD3):
    """TD3 with a cloning term: the actor's loss is ``-alpha Q / mean|Q|`` plus the squared difference.

    Args:
        alpha: weight of the value relative to the cloning term.
    """

    def __init__(self, policy: Any, env: Any, alpha: float = 2.5, **arguments: Any) -> None:
        self.alpha = alpha
        super().__init__(policy, env, **arguments)

    def _update(self, batch: Batch) -> dict[str, float]:
        obs, actions = batch.observations, batch.actions
        with torch.no_grad():
            noise = torch.randn_like(actions) * self.target_policy_noise
            noise = noise.clamp(-self.target_noise_clip, self.target_noise_clip)
            next_actions = (self.actor_target(batch.next_observations) + noise).clamp(-1, 1)
            next_value = _least(self.critic_target, batch.next_observations, next_actions)
            target = batch.rewards + self.gamma * next_value
        critic_loss = _squared(self.critic(obs, actions), target)
        _minimize(self.critic.optimizer, critic_loss)
        losses = {"critic_loss": critic_loss.item()}
        if self._n_updates % self.policy_delay == 0:
            chosen = self.actor(obs)
            value = self.critic.q1_forward(obs, chosen)
            cloning_loss = mse_loss(chosen, actions)
            _minimize(
                self.actor.optimizer, cloning_loss - self.alpha * value.mean() / value.abs().mean().detach()
            )
            losses["cloning_loss"] = cloning_loss.item()
            polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
            polyak_update(self.actor.parameters(), self.actor_target.parameters(), self.tau)
        return losses


class CQL(OfflineAlgorithm, SAC):
    """SAC whose values are also lowered for actions outside the data; its targets have no entropy term.

    Args:
        alpha: weight of the conservative penalty.
        n_actions: number of actions per state that are drawn from each of three distributions: uniform, the
            policy, and the policy in the next state.
    """

    def __init__(
        self, policy: Any, env: Any, alpha: float = 5.0, n_actions: int = 10, **arguments: Any
    ) -> None:
        self.alpha, self.n_actions = alpha, n_actions
        super().__init__(policy, env, **arguments)

    def _update(self, batch: Batch) -> dict[str, float]:
        obs = batch.observations
        chosen, log_prob = self.actor.action_log_prob(obs)
        entropy_weight = self._entropy_weight(log_prob)
        with torch.no_grad():
            next_actions = self.actor.action_log_prob(batch.next_observations)[0]
            next_value = _least(self.critic_target, batch.next_observations, next_actions)
            target = batch.rewards + self.gamma * next_value
        values = self.critic(obs, batch.actions)
        critic_loss = 0.5 * _squared(values, target)
        gap = self._log_sum_exp(batch) - torch.cat(values, 1).sum(1).mean()
        _minimize(self.critic.optimizer, critic_loss + self.alpha * gap)
        policy_loss = (entropy_weight * log_prob - _least(self.critic, obs, chosen).flatten()).mean()
        _minimize(self.actor.optimizer, policy_loss)
        polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
        return {
            "critic_loss": critic_loss.item(),
            "conservative_gap": gap.item(),
            "actor_loss": policy_loss.item(),
        }

    def _entropy_weight(self, log_prob: torch.Tensor) -> torch.Tensor:
        """Return the weight of the entropy, which is adapted to the target entropy if it is ``auto``."""
        if self.ent_coef_optimizer is None:
            return self.ent_coef_tensor
        assert self.log_ent_coef is not None
        surplus = (log_prob.detach() + float(self.target_entropy)).mean()
        _minimize(self.ent_coef_optimizer, -(self.log_ent_coef * surplus).mean())
        return self.log_ent_coef.detach().exp()

    def _log_sum_exp(self, batch: Batch) -> torch.Tensor:
        """Return the mean log-sum-exp of the values over all actions, summed over the critics."""
        count, drawn = len(batch.observations), self.n_actions
        obs = batch.observations.repeat(drawn, 1)
        with torch.no_grad():
            even = torch.rand(len(obs), ACTION_SIZE) * 2 - 1
            now, now_log_prob = self.actor.action_log_prob(obs)
            later, later_log_prob = self.actor.action_log_prob(batch.next_observations.repeat(drawn, 1))
        even_log_prob = torch.full_like(now_log_prob, -ACTION_SIZE * math.log(2))
        log_prob = torch.cat((even_log_prob, now_log_prob, later_log_prob)).view(-1, count)
        values = self.critic(obs.repeat(3, 1), torch.cat((even, now, later)))
        sums = [torch.logsumexp(each.view(-1, count) - log_prob, 0) for each in values]
        return cast(torch.Tensor, sum(sums)).mean() - len(sums) * math.log(len(log_prob))


class DiscreteCQL(OfflineAlgorithm, DQN):
    """DQN whose values are also lowered for choices that the data does not contain.

    Args:
        alpha: weight of the conservative penalty.
        tau: coefficient of the target network's update after each step.
    """

    modes: ClassVar[tuple[str, ...]] = ("discrete",)

    def __init__(
        self, policy: Any, env: Any, alpha: float = 1.0, tau: float = 0.005, **arguments: Any
    ) -> None:
        self.alpha = alpha
        super().__init__(policy, env, tau=tau, **arguments)

    def _update(self, batch: Batch) -> dict[str, float]:
        with torch.no_grad():
            next_value = self.q_net_target(batch.next_observations).max(1, keepdim=True).values
            target = batch.rewards + self.gamma * next_value
        values = self.q_net(batch.observations)
        value = values.gather(1, batch.actions[:, None])
        critic_loss = smooth_l1_loss(value, target)
        gap = (values.logsumexp(1, keepdim=True) - value).mean()
        _minimize(self.policy.optimizer, critic_loss + self.alpha * gap)
        polyak_update(self.q_net.parameters(), self.q_net_target.parameters(), self.tau)
        return {"critic_loss": critic_loss.item(), "conservative_gap": gap.item()}


class BC(OfflineAlgorithm):
    """Behaviour cloning with PPO's networks: least squares for the mean, maximum likelihood for choices.

    The standard deviation stays at ``log_std_init``, and the critic is fitted to the discounted returns, so
    that PPO can start from a clone.
    """

    modes: ClassVar[tuple[str, ...]] = ("continuous", "discrete")

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": ActorCriticPolicy}

    def __init__(
        self,
        policy: Any,
        env: Any,
        learning_rate: Any = 3e-4,
        supported_action_spaces: Any = (spaces.Box, spaces.Discrete),
        **arguments: Any,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate=learning_rate,
            support_multi_env=True,
            sde_support=False,
            supported_action_spaces=supported_action_spaces,
            **arguments,
        )
        self._setup_model()

    def _update(self, batch: Batch) -> dict[str, float]:
        policy = cast(ActorCriticPolicy, self.policy)
        cloning_loss = actor_loss(policy, batch.observations, batch.actions)
        critic_loss = mse_loss(policy.predict_values(batch.observations), batch.returns)
        _minimize(policy.optimizer, cloning_loss + 0.5 * critic_loss)
        return {"cloning_loss": cloning_loss.item(), "critic_loss": critic_loss.item()}

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []


class IQL(BC):
    """IQL with PPO's networks, whose critic learns an expectile of the value, and two Q-networks.

    Args:
        expectile: above 0.5, so that better actions weigh more.
        beta: inverse temperature: an action's weight in the policy's regression is exp(beta advantage).
    """

    modes: ClassVar[tuple[str, ...]] = ("continuous",)

    def __init__(
        self, policy: Any, env: Any, expectile: float = 0.7, beta: float = 3.0, **arguments: Any
    ) -> None:
        self.expectile, self.beta = expectile, beta
        super().__init__(policy, env, supported_action_spaces=(spaces.Box,), **arguments)

    def _setup_model(self) -> None:
        super()._setup_model()
        policy = cast(ActorCriticPolicy, self.policy)
        arch = policy.net_arch
        self.critic, self.critic_target = (
            ContinuousCritic(
                self.observation_space,
                cast(spaces.Box, self.action_space),
                arch["vf"] if isinstance(arch, dict) else arch,
                features := FlattenExtractor(self.observation_space),
                features.features_dim,
            ).to(self.device)
            for _ in range(2)
        )
        self.critic_target.load_state_dict(self.critic.state_dict())
        self.critic.optimizer = policy.optimizer_class(
            self.critic.parameters(),
            lr=self.lr_schedule(1),  # type: ignore[call-arg]
            **policy.optimizer_kwargs,
        )

    def _update(self, batch: Batch) -> dict[str, float]:
        policy = cast(ActorCriticPolicy, self.policy)
        obs, actions = batch.observations, batch.actions
        with torch.no_grad():
            best = _least(self.critic_target, obs, actions)
            target = batch.rewards + self.gamma * policy.predict_values(batch.next_observations)
        value, log_prob, _ = policy.evaluate_actions(obs, actions)
        advantage = best - value
        weight = torch.where(advantage > 0, self.expectile, 1 - self.expectile)
        value_loss = (weight * advantage.square()).mean()
        scale = (self.beta * advantage.detach()).exp().clamp(max=_GREATEST_WEIGHT).flatten()
        policy_loss = -(scale * log_prob).mean()
        _minimize(policy.optimizer, value_loss + policy_loss)
        critic_loss = _squared(self.critic(obs, actions), target)
        _minimize(self.critic.optimizer, critic_loss)
        polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
        return {
            "critic_loss": critic_loss.item(),
            "value_loss": value_loss.item(),
            "actor_loss": policy_loss.item(),
        }

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "critic", "critic_target"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return [*super()._get_torch_save_params()[0], "critic", "critic_target", "critic.optimizer"], []


def _least(critic: ContinuousCritic, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
    """Return the lowest value ``(n, 1)`` of all critics."""
    return torch.cat(critic(obs, actions), 1).min(1, keepdim=True).values


def _squared(values: tuple[torch.Tensor, ...], target: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error, summed over the critics."""
    return cast(torch.Tensor, sum(mse_loss(value, target) for value in values))


def _minimize(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
