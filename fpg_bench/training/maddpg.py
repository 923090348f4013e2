"""MADDPG: both players learn at once, each with a critic that sees what all players see and do.

Lowe et al., "Multi-Agent Actor-Critic for Mixed Cooperative-Competitive Environments" (NeurIPS 2017), with
the defaults of Table 3 of the paper. All players together are one model of SB3's kind: it observes
what all of them observe, one after the other, and gives all their actions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy, ContinuousCritic
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.td3.policies import Actor

from fpg_bench.training.maddpg_learner import Learner
from fpg_bench.training.maddpg_policy import JointPolicy

_ROWS = ("observations", "actions", "next_observations", "rewards", "dones", "timeouts")  # of a buffer


class Transitions(NamedTuple):
    """What was seen, done and got, float32: arrays ``(..., n, size)`` with a reward for each player."""

    observations: np.ndarray
    actions: np.ndarray
    next_observations: np.ndarray
    dones: np.ndarray
    rewards: np.ndarray


class JointBuffer(ReplayBuffer):
    """SB3's replay buffer with a reward for each player."""

    def __init__(self, *arguments: Any, players: int, reward_scale: float, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.rewards = np.zeros((self.buffer_size, self.n_envs, players), np.float32)
        self._scale = reward_scale

    def sample_many(self, times: int, batch_size: int) -> Transitions:
        """As many batches ``(times, n, size)`` as ``sample`` would draw one after the other."""
        steps = self.buffer_size if self.full else self.pos
        drawn = [
            [np.random.randint(0, bound, batch_size) for bound in (steps, self.n_envs)]  # noqa: NPY002
            for _ in range(times)
        ]
        return self._at(*np.array(drawn, int).reshape(times, 2, batch_size).swapaxes(0, 1))

    def _get_samples(self, batch_inds: np.ndarray, env: Any = None) -> ReplayBufferSamples:
        """As SB3's, but rewards are ``(batch, players)``."""
        games = np.random.randint(0, self.n_envs, len(batch_inds))  # noqa: NPY002
        return ReplayBufferSamples(*map(self.to_torch, self._at(batch_inds, games)))

    def __getstate__(self) -> dict[str, Any]:
        filled = self.buffer_size if self.full else self.pos
        return self.__dict__ | {name: getattr(self, name)[:filled] for name in _ROWS}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in _ROWS:
            whole = np.zeros((self.buffer_size, *state[name].shape[1:]), state[name].dtype)
            whole[: len(state[name])] = state[name]
            setattr(self, name, whole)

    def _at(self, steps: np.ndarray, games: np.ndarray) -> Transitions:
        """The transitions of these steps and games, arrays ``(...)``; only a round's own end ends it."""
        at = steps * self.n_envs + games
        seen, did, then, got, over, cut = (
            each.reshape(self.buffer_size * self.n_envs, -1).take(at, axis=0)
            for each in (getattr(self, name) for name in _ROWS)
        )
        return Transitions(seen, did, then, over * (1 - cut), got * self._scale)


class WhiteNoise(VectorizedActionNoise):
    """Normal noise on all actions of all games, drawn at once; SB3 draws it game by game.

    Args:
        sd: its standard deviation.
        shape: of the actions, ``(games, size)``.
    """

    def __init__(self, sd: float, shape: tuple[int, int]) -> None:
        super().__init__(NormalActionNoise(np.zeros(shape[1]), np.full(shape[1], sd)), shape[0])
        self._sd, self._shape = sd, shape

    def __call__(self) -> np.ndarray:
        """Draw ``(games, size)`` float32."""
        return np.random.normal(0, self._sd, self._shape).astype(np.float32)  # noqa: NPY002

    def reset(self, indices: Iterable[int] | None = None) -> None:
        """Do nothing: it remembers nothing."""


class MADDPG(OffPolicyAlgorithm):
    """MADDPG in Stable-Baselines3's manner: ``learn``, ``predict``, ``save`` and ``load``.

    Args:
        policy: ``JointPolicy``, the only one.
        env: games of several players as one ``VecEnv``: observations ``(n, all)``, actions ``(n, all)``,
            rewards ``(n, players)``, and an attribute ``sizes``, the size of each player's observation and
            action; :func:`fpg_bench.envs.sb3.make_sb3_duel` for instance.
        gamma, batch_size, learning_rate, buffer_size: Table 3 of the paper, which also says that the loss is
            the mean squared error.
        tau: how much of the networks goes into the targets at an update; the paper does not say.
        noise_sd: standard deviation of the normal noise on actions in [-1, 1] (Algorithm 1, line 5; the paper
            does not say how much).
        reward_scale: what rewards are multiplied with before critics learn them; the paper does not say.
        logit_penalty, logit_limit: what the mean square of an actor's outputs before tanh, as far as they are
            beyond the limit, costs it, so that actions do not stick to their bounds; Lowe et al.'s own code
            has 0.001 and no limit, the paper does not say. Below the limit a closed gate can stay further
            from its threshold than the noise reaches.
        learning_starts: steps at random before the first update; the paper does not say.
        train_freq, gradient_steps: after how many steps of all games there are how many updates; Algorithm 1
            has one after each step of its one game.
        policy_kwargs: of :class:`JointPolicy`; the paper does not say which networks.
        tensorboard_log, verbose, seed, device: as everywhere in SB3.

    Raises:
        ValueError: games without ``sizes``.
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"JointPolicy": JointPolicy}
    policy: JointPolicy

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
            replay_buffer_class=JointBuffer,
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
        self.action_noise = WhiteNoise(self.noise_sd, (self.n_envs, size))
        super()._setup_model()

    @property
    def players(self) -> list[OnePlayer]:
        """Each player as a model of its own."""
        return [OnePlayer(self, player) for player in range(len(self.policy.sizes))]

    @property
    def updates(self) -> int:
        """How often its networks were updated."""
        return self._n_updates

    def begin_learning(self, steps: int) -> None:
        """Prepare for so many steps, as ``learn`` does."""
        self._setup_learn(steps)

    def play_on(self) -> int:
        """Play as many steps as there are between updates; gives how many updates follow, which it counts."""
        self.collect_rollouts(
            self.env,  # type: ignore[arg-type]
            self._init_callback(None),
            self.train_freq,  # type: ignore[arg-type]
            self.replay_buffer,  # type: ignore[arg-type]
            self.action_noise,
            self.learning_starts,
        )
        updates = self.gradient_steps if self.num_timesteps > self.learning_starts else 0
        self._n_updates += updates
        return updates

    def train(self, gradient_steps: int, batch_size: int = 32) -> None:
        """Update all critics and actors, as often as asked."""
        self.policy.set_training_mode(True)
        learner = self._learner()
        self._update_learning_rate([learner.actor_optimizer, learner.critic_optimizer])
        for _ in range(gradient_steps):
            critic_loss, actor_loss = learner.update(self.replay_buffer.sample(batch_size))  # type: ignore[union-attr]
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/actor_loss", actor_loss.item())
        self.logger.record("train/critic_loss", critic_loss.item())

    def _learner(self) -> Learner:
        policy = self.policy
        actors, actor_targets = (
            [cast(Actor, actor).mu[:-1] for actor in part]  # the last layer is tanh
            for part in (policy.actors, policy.actor_targets)
        )
        weights, targets = (
            [each.data for part in parts for each in part.parameters()]
            for parts in ((policy.actors, policy.critics), (policy.actor_targets, policy.critic_targets))
        )
        critics, critic_targets = (
            [cast(ContinuousCritic, critic).q1_forward for critic in part]
            for part in (policy.critics, policy.critic_targets)
        )
        return Learner(
            policy.sizes,
            actors,
            critics,
            actor_targets,
            critic_targets,
            policy.actor_optimizer,
            policy.critic_optimizer,
            weights,
            targets,
            self.gamma,
            self.tau,
            self.logit_penalty,
            self.logit_limit,
        )

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.actor_optimizer", "policy.critic_optimizer"], []


class OnePlayer:
    """One player of a joint model as a model of its own, to be scored and exported.

    Args:
        model: a trained model; its present actor is shared, not copied.
        player: which of its players, counted from 0.
    """

    def __init__(self, model: MADDPG, player: int) -> None:
        self.policy = cast(Actor, model.policy.actors[player])
        self.observation_space = self.policy.observation_space
        self.predict = self.policy.predict

    def get_vec_normalize_env(self) -> None:
        """There is none."""
