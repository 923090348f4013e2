"""A start from imitation: the learner's own networks first learn what a player does and what that earns."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import mse_loss

from fpg_bench.envs.sb3 import SB3View
from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import Player
from fpg_bench.players.seat import Seat
from fpg_bench.training.imitation_words import Imitation


def teacher_of(imitation: Imitation, model: BaseAlgorithm, side: str, scenario: Scenario) -> Player:
    """The player to imitate.

    Raises:
        UserError: no such player, one of the other side, or a model that is not of PPO's kind.
    """
    if not isinstance(model.policy, ActorCriticPolicy) or hasattr(model.policy, "lstm_actor"):
        raise UserError(
            f"imitate: PPO and its kind, without an LSTM, can imitate; {type(model).__name__} can't"
        )
    return as_player(imitation.teacher, side, scenario)


def imitate(
    model: BaseAlgorithm,
    games: SB3View,
    imitation: Imitation,
    stop: threading.Event | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> float:
    """Let a model begin as a player's pupil.

    In half of the games the teacher plays, in the others the pupil, and the teacher says what it would do
    there (Ross et al. 2011, DAgger). The actor's mean learns that by least squares, the critic the discounted
    return. How widely actions are drawn stays as it is.

    Args:
        model: its environment wraps ``games``.
        games: one side's games; they have played when this returns, so seed and reset them.
        imitation: of whom, and how long.
        stop: ends it where it is set.
        say: told a line per round.

    Returns:
        The mean squared difference of an action to the teacher's in the last round, before learning from it.

    Raises:
        UserError: see :func:`teacher_of`.
        KeyboardInterrupt: it was stopped.
    """
    core = games.core
    teacher = teacher_of(imitation, model, core.side, core.scenario)
    env: Any = model.get_env()
    lesson = _Lesson(model, env, games, Seat(core.side, [teacher], core.duel.arena), imitation)
    played, error = 0, float("nan")
    while played < imitation.steps:
        if stop is not None and stop.is_set():
            raise KeyboardInterrupt("stopped while it imitated; nothing is saved")
        error = lesson.round(pupils=played > 0)
        played += lesson.length * env.num_envs
        say(f"imitating {imitation.teacher}: {played:,} steps, squared difference {error:.4f}")
    return error


class _Lesson:
    """Rounds of a teacher and its pupil."""

    def __init__(
        self, model: BaseAlgorithm, env: VecEnv, games: SB3View, seat: Seat, imitation: Imitation
    ) -> None:
        self._model, self._env, self._seat, self._imitation = model, env, seat, imitation
        self._policy: Any = model.policy
        self._gamma: float = getattr(model, "gamma", 0.99)
        self._adam = torch.optim.Adam(self._policy.parameters(), lr=imitation.learning_rate)
        self.length = min(games.core.scenario.steps_per_round, -(-imitation.steps // env.num_envs))
        self._seen = np.asarray(env.reset())
        seat.begin(np.ones(env.num_envs, bool))

    def round(self, pupils: bool) -> float:
        """Play for a round's steps, then learn from them; how far the pupil was from the teacher."""
        seen, taught, earned, over = [], [], [], []
        for _ in range(self.length):
            wanted = np.clip(self._seat.act(), -1, 1)
            seen.append(self._seen)
            taught.append(wanted)
            played = wanted.copy()
            if pupils:
                played[1::2] = self._model.predict(self._seen[1::2], deterministic=False)[0]
            self._seen, rewards, dones, _ = self._env.step(played)  # type: ignore[assignment]
            if dones.any():
                self._seat.begin(dones)
            earned.append(rewards)
            over.append(dones)
        returns = self._returns(np.array(earned), np.array(over))
        return self._learn(*(torch.as_tensor(np.concatenate(part)) for part in (seen, taught, returns)))

    def _returns(self, earned: np.ndarray, over: np.ndarray) -> np.ndarray:
        """``(T, N)`` float32 discounted returns; the critic says what comes after a cut."""
        with torch.no_grad():
            last = self._policy.predict_values(torch.as_tensor(self._seen)).numpy().ravel()
            mean = float(earned.mean()) / (1 - self._gamma)  # what comes after a round's end, on the whole
        found = np.empty(earned.shape, np.float32)
        for step in range(len(earned) - 1, -1, -1):
            last = earned[step] + self._gamma * np.where(over[step], mean, last)
            found[step] = last
        return found

    def _learn(self, seen: torch.Tensor, taught: torch.Tensor, returns: torch.Tensor) -> float:
        with torch.no_grad():
            before = mse_loss(self._means(seen).clamp(-1, 1), taught).item()
        for _ in range(self._imitation.n_epochs):
            for rows in torch.randperm(len(seen)).split(self._imitation.batch_size):
                values = self._policy.predict_values(seen[rows]).flatten()
                loss = mse_loss(self._means(seen[rows]), taught[rows]) + 0.5 * mse_loss(values, returns[rows])
                self._adam.zero_grad()
                loss.backward()
                self._adam.step()
        return before

    def _means(self, seen: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self._policy.get_distribution(seen).mode()
        return found
