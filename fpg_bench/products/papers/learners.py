"""Learners of the papers: variants of DQN on Stable-Baselines3, tabular Q-learning, play of matrix games."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork

from fpg_bench.evaluation.statistics import nash

Strategies = tuple[np.ndarray, np.ndarray]  # of rows and of columns


class PrioritisedBuffer(ReplayBuffer):
    """A replay buffer that draws transitions by a power of their last error (Schaul et al. 2016).

    Attributes:
        drawn: indices of the last batch.
        weights: its importance-sampling weights, the greatest of which is 1.
    """

    alpha, beta, least = 0.6, 0.1, 1e-8

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._errors = np.zeros(self.buffer_size)
        self.drawn, self.weights = np.zeros(0, int), np.zeros(0)

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Add a transition with the greatest error so far, so that it is drawn soon."""
        self._errors[self.pos] = max(1.0, self._errors.max())
        super().add(*args, **kwargs)

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """Draw a batch."""
        chances = (self._errors[: self.size()] + self.least) ** self.alpha
        chances /= chances.sum()
        self.drawn = np.random.choice(len(chances), batch_size, p=chances)  # noqa: NPY002 (SB3 seeds this generator)
        weights = (len(chances) * chances[self.drawn]) ** -self.beta
        self.weights = weights / weights.max()
        return self._get_samples(self.drawn, env)

    def update(self, errors: np.ndarray) -> None:
        """Store the errors of the last batch."""
        self._errors[self.drawn] = np.abs(errors)


class Dueling(torch.nn.Module):
    """The values of all actions, from their advantages and, in the last column, a value."""

    def forward(self, output: torch.Tensor) -> torch.Tensor:
        """Return the value and the advantages, less their mean."""
        advantages = output[:, :-1]
        return output[:, -1:] + advantages - advantages.mean(1, keepdim=True)


class DuelingNetwork(QNetwork):
    """A Q-network that adds a value and advantages (Wang et al. 2016)."""

    def __init__(
        self, observation_space: Any, action_space: gymnasium.spaces.Discrete, **kwargs: Any
    ) -> None:
        super().__init__(observation_space, gymnasium.spaces.Discrete(int(action_space.n) + 1), **kwargs)
        self.q_net.append(Dueling())


class DuelingPolicy(DQNPolicy):
    """SB3's policy of DQN with dueling networks."""

    def make_q_net(self) -> QNetwork:
        """Return a dueling network."""
        return DuelingNetwork(**self._update_features_extractor(self.net_args)).to(self.device)


class VariantDQN(DQN):
    """DQN with the squared error, and as the attribute, policy and replay buffer say, with its variants.

    Attributes:
        double: the network chooses the action whose value the target tells (van Hasselt et al. 2016).
    """

    double = False

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Update the network."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        buffer = self.replay_buffer
        assert buffer is not None
        for _ in range(gradient_steps):
            batch = buffer.sample(batch_size, env=self._vec_normalize_env)
            with torch.no_grad():
                values = self.q_net_target(batch.next_observations)
                chosen = self.q_net(batch.next_observations) if self.double else values
                following = values.gather(1, chosen.argmax(1, keepdim=True))
                discounts = self.gamma if batch.discounts is None else batch.discounts
                targets = batch.rewards + (1 - batch.dones) * discounts * following
            errors = self.q_net(batch.observations).gather(1, batch.actions.long()) - targets
            squares = errors.square()
            if isinstance(buffer, PrioritisedBuffer):
                squares = squares * torch.as_tensor(buffer.weights[:, None], dtype=squares.dtype)
                buffer.update(errors.detach().numpy()[:, 0])
            loss = squares.mean()
            self.policy.optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
            self.policy.optimizer.step()
        self._n_updates += gradient_steps
        self.logger.record("train/loss", loss.item())


class DuelingDDQN(VariantDQN):
    """Double DQN with dueling networks and the squared error."""

    double = True
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": DuelingPolicy}


def q_learning(
    env: gymnasium.Env[Any, np.int64],
    state_of: Callable[[Any], int],
    states: int,
    steps: int,
    seed: int,
    *,
    rate: float,
    gamma: float,
    exploration: Callable[[float], float],
) -> np.ndarray:
    """Learn a table of values by Q-learning (Watkins 1989).

    Args:
        env: environment with discrete actions.
        state_of: number of the state of an observation.
        states: number of states.
        steps: steps of the training.
        seed: of the environment and of random actions.
        rate: learning rate.
        gamma: discount factor.
        exploration: share of random actions, given the share of the training that is over.

    Returns:
        The values, ``(states, actions)``.
    """
    actions = int(env.action_space.n)  # type: ignore[attr-defined]
    values, generator = np.zeros((states, actions)), np.random.default_rng(seed)
    state = state_of(env.reset(seed=seed)[0])
    for step in range(steps):
        random = generator.random() < exploration(step / steps)
        action = generator.integers(actions) if random else values[state].argmax()
        observation, reward, terminated, truncated, _ = env.step(np.int64(action))
        following = state_of(observation)
        target = float(reward) + gamma * values[following].max() * (not terminated)
        values[state, action] += rate * (target - values[state, action])
        state = state_of(env.reset()[0]) if terminated or truncated else following
    return values


def fictitious_play(
    payoffs: np.ndarray, rounds: Sequence[int], seed: int, *, noise: float = 0.0
) -> list[Strategies]:
    """Let both sides of a zero-sum game answer what the other one has chosen so far (Brown 1951).

    Args:
        payoffs: ``(m, n)``, what rows win from columns.
        rounds: numbers of rounds after which the strategies are returned, ascending.
        seed: of the first choices and of the noise.
        noise: scale of Gumbel noise on the sums of pay-offs, with which each side draws as Hedge does with
            the rate 1 / ``noise``; 0 is fictitious play.

    Returns:
        How often rows and columns were chosen, as shares, after each of these numbers of rounds.
    """
    generator = np.random.default_rng(seed)
    gains, losses = generator.random(len(payoffs)), generator.random(len(payoffs.T))
    rows, columns = np.zeros_like(gains), np.zeros_like(losses)
    strategies: list[Strategies] = []
    for played in range(1, rounds[-1] + 1):
        row, column = gains.argmax(), losses.argmin()
        if noise:
            row = (gains + noise * generator.gumbel(size=gains.size)).argmax()
            column = (losses - noise * generator.gumbel(size=losses.size)).argmin()
        gains += payoffs[:, column]
        losses += payoffs[row]
        rows[row] += 1
        columns[column] += 1
        strategies += [(rows / played, columns / played)] * rounds.count(played)
    return strategies


def minimax_q(
    payoffs: np.ndarray, rounds: Sequence[int], seed: int, *, exploration: float, solutions: int = 50
) -> list[Strategies]:
    """Let both sides of a zero-sum game of one state learn its pay-offs and play its solution (Littman 1994).

    Args:
        payoffs: ``(m, n)``, what rows win from columns; a side sees those of the pairs that were chosen.
        rounds: numbers of rounds after which the strategies are returned, ascending.
        seed: of the choices.
        exploration: share of random choices.
        solutions: how often the table is solved in the course of the training.

    Returns:
        The solutions of the table, rows and columns, after each of these numbers of rounds.
    """
    generator, table = np.random.default_rng(seed), np.zeros(payoffs.shape)
    every, strategies = max(1, rounds[-1] // solutions), []
    sides: Strategies = (np.ones(len(payoffs)), np.ones(len(payoffs.T)))
    for played in range(1, rounds[-1] + 1):
        row, column = (
            generator.integers(side.size) if generator.random() < exploration else _draw(side, generator)
            for side in sides
        )
        table[row, column] = payoffs[row, column]
        if played % every == 0 or played in rounds:
            sides = nash(-table)[:2]
        strategies += [sides] * rounds.count(played)
    return strategies


def _draw(chances: np.ndarray, generator: np.random.Generator) -> int:
    """Draw an index in proportion to chances, whose sum need not be 1."""
    sums = chances.cumsum()
    return int(np.searchsorted(sums, generator.random() * sums[-1], side="right"))
