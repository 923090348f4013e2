"""MADDPG with Stable-Baselines3's interface.

Lowe et al., "Multi-Agent Actor-Critic for Mixed Cooperative-Competitive Environments" (NeurIPS 2017), with
the defaults of Table 3 of the paper. All players together are one model: its observations and actions are
those of all players, concatenated.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy, ContinuousCritic
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from stable_baselines3.td3.policies import Actor
from torch.nn import functional

from fpg_bench.products.maddpg.policies import JointPolicy, act_separately

_ARRAYS = ("observations", "actions", "next_observations", "rewards", "dones", "timeouts")  # of a buffer


class JointTransitions(NamedTuple):
    """Transitions as float32 arrays ``(..., n, size)``, with a reward for each player."""

    observations: np.ndarray
    actions: np.ndarray
    next_observations: np.ndarray
    dones: np.ndarray
    rewards: np.ndarray


class JointReplayBuffer(ReplayBuffer):
    """SB3's replay buffer with a reward for each player."""

    def __init__(self, *args: Any, players: int, reward_scale: float, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.rewards = np.zeros((self.buffer_size, self.n_envs, players), np.float32)
        self._reward_scale = reward_scale

    def sample_many(self, times: int, batch_size: int) -> JointTransitions:
        """Sample batches ``(times, n, size)``, equal to as many calls of ``sample``."""
        upper = self.buffer_size if self.full else self.pos
        indices = [
            [np.random.randint(0, bound, batch_size) for bound in (upper, self.n_envs)]  # noqa: NPY002
            for _ in range(times)
        ]
        return self._transitions(*np.array(indices, int).reshape(times, 2, batch_size).swapaxes(0, 1))

    def _get_samples(self, batch_inds: np.ndarray, env: VecNormalize | None = None) -> ReplayBufferSamples:
        env_indices = np.random.randint(0, self.n_envs, len(batch_inds))  # noqa: NPY002
        return ReplayBufferSamples(*map(self.to_torch, self._transitions(batch_inds, env_indices)))

    def _transitions(self, batch_inds: np.ndarray, env_indices: np.ndarray) -> JointTransitions:
        """Return the transitions of index arrays ``(...)``; time limits do not count as done."""
        indices = batch_inds * self.n_envs + env_indices
        obs, actions, next_obs, rewards, dones, timeouts = (
            getattr(self, name).reshape(self.buffer_size * self.n_envs, -1).take(indices, axis=0)
            for name in _ARRAYS
        )
        return JointTransitions(obs, actions, next_obs, dones * (1 - timeouts), rewards * self._reward_scale)


class BatchedNormalNoise(VectorizedActionNoise):
    """Normal noise for the actions of all games, drawn in one call; SB3 draws it game by game.

    Args:
        sigma: standard deviation.
        shape: shape of the actions, ``(games, size)``.
    """

    def __init__(self, sigma: float, shape: tuple[int, int]) -> None:
        super().__init__(NormalActionNoise(np.zeros(shape[1]), np.full(shape[1], sigma)), shape[0])
        self._sigma, self._shape = sigma, shape

    def __call__(self) -> np.ndarray:
        """Draw ``(games, size)`` float32."""
        return np.random.normal(0, self._sigma, self._shape).astype(np.float32)  # noqa: NPY002

    def reset(self, indices: Iterable[int] | None = None) -> None:
        """Do nothing; the noise has no state."""


class MADDPG(OffPolicyAlgorithm):
    """MADDPG with Stable-Baselines3's interface: ``learn``, ``predict``, ``save`` and ``load``.

    >>> import fpg_bench
    >>> games = fpg_bench.make_sb3("FPG/duel_v0", 2, seed=0)
    >>> model = MADDPG("JointPolicy", games, buffer_size=100, seed=0).learn(20)
    >>> model.predict(games.reset())[0].shape
    (2, 18)

    Args:
        policy: ``JointPolicy``, the only one.
        env: games of several players as one ``VecEnv``: observations ``(n, all)``, actions ``(n, all)``,
            rewards ``(n, players)``, and an attribute ``sizes``, the size of each player's observation and
            action; ``fpg_bench.make_sb3("FPG/duel_v0", 8)`` for instance.
        gamma, batch_size, learning_rate, buffer_size: as in Table 3 of the paper, which also states the mean
            squared error as the loss.
        tau: coefficient of the target networks' updates; not given in the paper.
        noise_sd: standard deviation of the normal noise on actions in [-1, 1] (Algorithm 1, line 5); its size
            is not given in the paper.
        reward_scale: factor of the rewards that the critics learn from; not given in the paper.
        logit_penalty, logit_limit: weight of the mean square of an actor's outputs before tanh, as far as
            they are beyond the limit, in the actor's loss. It keeps actions off their bounds. Lowe et al.'s
            own code has 0.001 without a limit; the paper gives neither. Within the limit a closed gate can
            stay further from its threshold than the noise reaches.
        learning_starts: random steps before the first update; not given in the paper.
        train_freq, gradient_steps: number of updates after a number of steps of all games; Algorithm 1 has
            one after each step of its single game.
        policy_kwargs: arguments of :class:`fpg_bench.products.maddpg.policies.JointPolicy`; the networks are
            not given in the paper.
        tensorboard_log, verbose, seed, device: as in SB3.

    Raises:
        ValueError: games without ``sizes``.
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"JointPolicy": JointPolicy}
    policy: JointPolicy
    replay_buffer: JointReplayBuffer

    def __init__(
        self,
        policy: str | type[JointPolicy],
        env: VecEnv,
        learning_rate: float = 0.001,
        buffer_size: int = 1_000_000,
        batch_size: int = 32,
        gamma: float = 0.99,
        tau: float = 0.01,
        noise_sd: float = 0.1,
        reward_scale: float = 1.0,
        logit_penalty: float = 0.0,
        logit_limit: float = 0.0,
        learning_starts: int = 1000,
        train_freq: int = 1,
        gradient_steps: int = 1,
        policy_kwargs: dict[str, Any] | None = None,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: str = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate,
            buffer_size,
            learning_starts,
            batch_size,
            tau,
            gamma,
            train_freq,
            gradient_steps,
            replay_buffer_class=JointReplayBuffer,
            policy_kwargs=policy_kwargs,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            device=device,
            seed=seed,
            support_multi_env=True,
            sde_support=False,
            supported_action_spaces=(spaces.Box,),
        )
        self.noise_sd, self.reward_scale = noise_sd, reward_scale
        self.logit_penalty, self.logit_limit = logit_penalty, logit_limit
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        if self.env is not None:
            sizes = self.env.get_attr("sizes")[0]
            self.policy_kwargs["sizes"] = sizes
            self.replay_buffer_kwargs = {"players": len(sizes), "reward_scale": self.reward_scale}
        (size,) = cast(spaces.Box, self.action_space).shape
        self.action_noise = BatchedNormalNoise(self.noise_sd, (self.n_envs, size))
        super()._setup_model()

    @property
    def players(self) -> list[SinglePlayer]:
        """Each player as a separate model."""
        return [SinglePlayer(self, player) for player in range(len(self.policy.sizes))]

    @property
    def n_updates(self) -> int:
        """Number of updates so far."""
        return self._n_updates

    def setup_learn(self, total_timesteps: int) -> None:
        """Prepare for a number of steps, as ``learn`` does."""
        self._setup_learn(total_timesteps, None)

    def collect(self) -> JointTransitions:
        """Play the steps between updates, and sample their batches ``(gradient_steps, n, size)``.

        The batches are empty before ``learning_starts``; all of them count as updates.
        """
        self.collect_rollouts(
            self.env,  # type: ignore[arg-type]
            self._init_callback(None),
            self.train_freq,  # type: ignore[arg-type]
            self.replay_buffer,
            self.action_noise,
            self.learning_starts,
        )
        updates = self.gradient_steps if self.num_timesteps > self.learning_starts else 0
        self._n_updates += updates
        return self.replay_buffer.sample_many(updates, self.batch_size)

    def train(self, gradient_steps: int, batch_size: int = 32) -> None:
        """Update all critics and actors ``gradient_steps`` times."""
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.policy.actor_optimizer, self.policy.critic_optimizer])
        critic_loss, actor_loss = self.update(self.replay_buffer.sample_many(gradient_steps, batch_size))
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/actor_loss", actor_loss.item())
        self.logger.record("train/critic_loss", critic_loss.item())

    def update(self, batches: JointTransitions) -> tuple[torch.Tensor, torch.Tensor]:
        """Update all critics and actors once with each of the batches ``(updates, n, size)``.

        Returns:
            The losses of critics and actors before the last update.
        """
        losses = _Losses(self)
        for batch in zip(*map(self.replay_buffer.to_torch, batches), strict=True):
            critic_loss, actor_loss = losses.update(ReplayBufferSamples(*batch))
        return critic_loss, actor_loss

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.actor_optimizer", "policy.critic_optimizer"], []


class SinglePlayer:
    """One player of a joint model as a separate model, for evaluation and export.

    Args:
        model: a trained model; its actor is shared, not copied.
        player: index of the player.
    """

    def __init__(self, model: MADDPG, player: int) -> None:
        self.policy = cast(Actor, model.policy.actors[player])
        self.observation_space = self.policy.observation_space
        self.predict = self.policy.predict


class _Losses:
    """Losses of all players' critics and actors, and an update of both (Lowe et al. 2017, Algorithm 1)."""

    def __init__(self, model: MADDPG) -> None:
        policy = self._policy = model.policy
        self._gamma, self._tau = model.gamma, model.tau
        self._logit_penalty, self._logit_limit = model.logit_penalty, model.logit_limit
        # Actors map observations to logits, whose tanh is the action, so the last layer is omitted
        self._actors, self._actor_targets = (
            [cast(Actor, actor).mu[:-1] for actor in actors]
            for actors in (policy.actors, policy.actor_targets)
        )
        self._critics, self._critic_targets = (
            [cast(ContinuousCritic, critic).q1_forward for critic in critics]
            for critics in (policy.critics, policy.critic_targets)
        )
        self._weights, self._targets = (
            [parameter.data for networks in pair for parameter in networks.parameters()]
            for pair in ((policy.actors, policy.critics), (policy.actor_targets, policy.critic_targets))
        )

    def update(self, batch: ReplayBufferSamples) -> tuple[torch.Tensor, torch.Tensor]:
        """Update critics, actors and targets once; returns the losses of critics and actors before."""
        critic_loss = self._critic_loss(batch)
        _descend(critic_loss, self._policy.critic_optimizer)
        actor_loss = self._actor_loss(batch)
        _descend(actor_loss, self._policy.actor_optimizer)
        torch._foreach_lerp_(self._targets, self._weights, self._tau)  # Polyak average
        return critic_loss, actor_loss

    def _critic_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        """Mean squared error of each critic, summed over players."""
        with torch.no_grad():
            next_obs = batch.next_observations
            logits = act_separately(self._policy.sizes, self._actor_targets, next_obs)
            next_actions = torch.cat(logits, -1).tanh()
            next_q = torch.cat([critic(next_obs, next_actions) for critic in self._critic_targets], -1)
            target_q = batch.rewards + (1 - batch.dones) * self._gamma * next_q
        q_values = [critic(batch.observations, batch.actions) for critic in self._critics]
        return functional.mse_loss(torch.cat(q_values, -1), target_q, reduction="sum") / target_q.shape[-2]

    def _actor_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        """Negative value of each player's own action among the others' past ones, and the logit penalty."""
        actions = torch.split(batch.actions, [size for _, size in self._policy.sizes], dim=-1)
        loss = torch.zeros(())
        for player, logits in enumerate(act_separately(self._policy.sizes, self._actors, batch.observations)):
            joint = torch.cat([*actions[:player], logits.tanh(), *actions[player + 1 :]], -1)
            loss = loss - self._critics[player](batch.observations, joint).sum()
            excess = (logits.abs() - self._logit_limit).relu()
            loss = loss + self._logit_penalty * excess.square().mean(-1).sum()
        return loss / batch.actions.shape[-2]


def _descend(loss: torch.Tensor, optimizer: torch.optim.Optimizer) -> None:
    optimizer.zero_grad()
    inputs = optimizer.param_groups[0]["params"]  # excludes the critics that evaluate an actor
    loss.backward(inputs=inputs)  # type: ignore[no-untyped-call]
    optimizer.step()
