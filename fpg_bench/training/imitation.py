"""Imitation before training: the networks first learn a teacher's actions and returns (DAgger)."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import mse_loss

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import StopRequest
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.player import Player
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.preprocessing import core_of
from fpg_bench.players.registry import as_player
from fpg_bench.training.hyperparameters import ImitationConfig

_logger = logging.getLogger(__name__)


def teacher_of(config: ImitationConfig, model: BaseAlgorithm, side: str, scenario: Scenario) -> Player:
    """Return the player to imitate.

    Raises:
        UserError: no such player, a player of the other side, or a model that is not PPO or the like.
    """
    if getattr(core_of(model), "samples", False):
        raise UserError("imitate: seats of a team learn without a teacher")
    if not isinstance(model.policy, ActorCriticPolicy) or hasattr(model.policy, "lstm_actor"):
        raise UserError(
            f"imitate: only PPO and the like without an LSTM can imitate, not {type(model).__name__}"
        )
    return as_player(config.teacher, side, scenario)


def imitate(
    model: BaseAlgorithm, games: FPGVecEnv, config: ImitationConfig, stop: StopRequest | None = None
) -> float:
    """Train a model to imitate a player.

    The teacher acts in half of the games and the model in the others, where the teacher's actions are the
    labels (Ross et al. 2011, DAgger). The actor's mean is fitted to them by least squares, and the critic to
    the discounted returns. The standard deviation of the actions is not changed. For discrete actions, the
    labels are the choices nearest to the teacher's actions, and their likelihood is maximised.

    Args:
        model: its environment wraps ``games``.
        games: the games of one side; seed and reset them afterwards, as imitation plays them.
        config: the teacher, and how long it is imitated.
        stop: request to end the imitation.

    Returns:
        The mean squared difference between the actions and the teacher's in the last round, before it is
        learned from; for discrete actions, the share of choices that differ.

    Raises:
        UserError: see :func:`teacher_of`.
        KeyboardInterrupt: stopped by the user.
    """
    core = games.core
    teacher = teacher_of(config, model, core.side, core.scenario)
    env: Any = model.get_env()
    imitation = _Imitation(model, env, games, PolicyRunner(core.side, [teacher], core.duel.batch), config)
    steps, error = 0, float("nan")
    while steps < config.steps:
        if stop is not None and stop.is_set:
            raise KeyboardInterrupt("stopped during imitation; nothing is saved")
        error = imitation.run_round(model_acts=steps > 0)
        steps += imitation.length * env.num_envs
        _logger.info(f"imitating {config.teacher}: {steps:,} steps, difference {error:.4f}")
    return error


class _Imitation:
    """Rounds of data collection, each followed by supervised updates."""

    def __init__(
        self,
        model: BaseAlgorithm,
        env: VecEnv,
        games: FPGVecEnv,
        teacher: PolicyRunner,
        config: ImitationConfig,
    ) -> None:
        self._model, self._env, self._teacher, self._config = model, env, teacher, config
        self._choices = games.core.duel.choices[games.core.side]
        self._policy: Any = model.policy
        self._gamma: float = getattr(model, "gamma", 0.99)
        self._optimizer = torch.optim.Adam(self._policy.parameters(), lr=config.learning_rate)
        self.length = min(games.core.scenario.steps_per_round, -(-config.steps // env.num_envs))
        self._obs = np.asarray(env.reset())
        teacher.begin(np.ones(env.num_envs, bool))

    def run_round(self, model_acts: bool) -> float:
        """Collect a round of data and fit the networks to it; returns the error before the fit."""
        all_obs, labels, all_rewards, all_dones = [], [], [], []
        for _ in range(self.length):
            label = np.clip(self._teacher.act(), -1, 1)
            if self._choices is not None:
                label = self._choices.encode(label, self._teacher.observations)
            all_obs.append(self._obs)
            labels.append(label)
            actions = label.copy()
            if model_acts:
                actions[1::2] = self._model.predict(self._obs[1::2], deterministic=False)[0]
            self._obs, rewards, dones, _ = self._env.step(actions)  # type: ignore[assignment]
            if dones.any():
                self._teacher.begin(dones)
            all_rewards.append(rewards)
            all_dones.append(dones)
        returns = self._returns(np.array(all_rewards), np.array(all_dones))
        return self._fit(*(torch.as_tensor(np.concatenate(part)) for part in (all_obs, labels, returns)))

    def _returns(self, rewards: np.ndarray, dones: np.ndarray) -> np.ndarray:
        """Return ``(T, N)`` float32 discounted returns, with the critic's value after the last step."""
        with torch.no_grad():
            value = self._policy.predict_values(torch.as_tensor(self._obs)).numpy().ravel()
        return discounted_returns(rewards, dones, value, self._gamma)

    def _fit(self, obs: torch.Tensor, labels: torch.Tensor, returns: torch.Tensor) -> float:
        with torch.no_grad():
            error = self._error(obs, labels)
        for _ in range(self._config.n_epochs):
            for rows in torch.split(torch.randperm(len(obs)), self._config.batch_size):
                values = self._policy.predict_values(obs[rows]).flatten()
                loss = actor_loss(self._policy, obs[rows], labels[rows])
                loss += 0.5 * mse_loss(values, returns[rows])
                self._optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                self._optimizer.step()
        return error

    def _error(self, obs: torch.Tensor, labels: torch.Tensor) -> float:
        mode: torch.Tensor = self._policy.get_distribution(obs).mode()
        if self._choices is None:
            return mse_loss(mode.clamp(-1, 1), labels).item()
        return float((mode != labels).float().mean())


def actor_loss(policy: ActorCriticPolicy, obs: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error of the mean actions; for choices the negative log-likelihood."""
    distribution = policy.get_distribution(obs)
    if isinstance(policy.action_space, spaces.Box):
        return mse_loss(distribution.mode(), labels)
    loss: torch.Tensor = -distribution.log_prob(labels).mean()
    return loss


def discounted_returns(rewards: np.ndarray, dones: np.ndarray, value: np.ndarray, gamma: float) -> np.ndarray:
    """Return the discounted returns ``(T, N)`` float32.

    Args:
        rewards: ``(T, N)``.
        dones: ``(T, N)`` bool, the ends of rounds; the value after an end is that of the mean reward.
        value: ``(N,)``, the values after the last step.
        gamma: discount factor.
    """
    mean = float(rewards.mean()) / (1 - gamma)  # value after a round's end, on average
    returns = np.empty(rewards.shape, np.float32)
    for step in range(len(rewards) - 1, -1, -1):
        value = rewards[step] + gamma * np.where(dones[step], mean, value)
        returns[step] = value
    return returns
