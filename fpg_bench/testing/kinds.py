"""One way to play every kind of view, so that one contract holds for all of them."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import SIDES


class Shown(NamedTuple):
    """What a step shows of N games, by whatever names the view has for it.

    Attributes:
        observations: ``(N, 15)`` of one side, ``(N, 30)`` of both; at a round's end those of its last step.
        rewards: ``(N,)`` of one side, ``(N, 2)`` of both.
        over: ``(N,)`` bool, the rounds that ended by truncation.
        terminated: whether any game has ended otherwise.
        returns: like ``rewards``, the rounds' returns as the measures say; None before their end.
        handed: the very arrays that the view gave.
    """

    observations: np.ndarray
    rewards: np.ndarray
    over: np.ndarray
    terminated: bool
    returns: np.ndarray | None
    handed: tuple[np.ndarray, ...]


class Hands:
    """A view in one's hands: N games of one side or of both.

    Args:
        view: it is new.

    Attributes:
        games: how many, N.
        shape: of one side's actions, as the view wants them.
        scenario: what is played.
    """

    sides: tuple[str, ...] = ()

    def __init__(self, view: Any) -> None:
        self.view = view
        self.games = 1
        self.shape: tuple[int, ...] = (ACTION_SIZE,)
        self.scenario = self._duel().scenario

    def _duel(self) -> Duel:
        return self.view.core.duel

    @property
    def width(self) -> int:
        """How many numbers a game's actions are, of all sides together."""
        return ACTION_SIZE * len(self.sides or (1,))

    def spaces(self) -> tuple[Any, ...]:
        """The spaces of one game's observations and actions, or none."""
        return self.view.observation_space, self.view.action_space

    def holds(self, observations: np.ndarray) -> bool:
        """Whether observations lie in their space."""
        return all(row in self.view.observation_space for row in observations)

    def reset(self, seed: Any = None) -> np.ndarray:
        """Begin a round in every game; gives the observations."""
        raise NotImplementedError

    def step(self, actions: Any) -> Shown:
        """Play a step; the actions go to the view as they are."""
        raise NotImplementedError

    def packed(self, actions: np.ndarray) -> Any:
        """Actions ``(N, width)`` as the view takes them."""
        return actions

    def next_round(self) -> None:
        """Begin the next round where the view does not by itself."""
        self.view.reset()


class _SingleHands(Hands):
    """One game by Gymnasium."""

    def reset(self, seed: Any = None) -> np.ndarray:
        return self.view.reset(seed=seed)[0][None]

    def step(self, actions: Any) -> Shown:
        observation, reward, terminated, truncated, info = self.view.step(actions)
        measures = info.get("measures")
        returns = None if measures is None else np.array([measures[f"{self.view.core.side}_return"]])
        over = np.array([truncated])
        return Shown(observation[None], np.array([reward]), over, terminated, returns, (observation,))

    def packed(self, actions: np.ndarray) -> Any:
        return actions[0].copy()


class _VectorHands(Hands):
    """N games by Gymnasium, which begin their next round in a step of its own."""

    def __init__(self, view: Any) -> None:
        super().__init__(view)
        self.games = view.num_envs
        self.shape = (self.games, ACTION_SIZE)

    def spaces(self) -> tuple[Any, ...]:
        view = self.view
        return view.observation_space, view.action_space, view.single_observation_space

    def holds(self, observations: np.ndarray) -> bool:
        return observations in self.view.observation_space

    def reset(self, seed: Any = None) -> np.ndarray:
        return self.view.reset(seed=seed)[0]

    def step(self, actions: Any) -> Shown:
        observations, rewards, terminated, over, infos = self.view.step(actions)
        measures = infos.get("measures")
        returns = None if measures is None else measures[f"{self.view.core.side}_return"]
        handed = (observations, rewards, terminated, over)
        return Shown(observations, rewards, over, terminated.any(), returns, handed)

    def next_round(self) -> None:
        self.view.step(np.zeros(self.shape, np.float32))


class _SB3Hands(Hands):
    """N games by Stable-Baselines3, of one side or of both, which begin their next round at once."""

    def __init__(self, view: Any) -> None:
        super().__init__(view)
        self.games = view.num_envs
        self.shape = (self.games, *view.action_space.shape)
        self.sides = SIDES if view.action_space.shape[0] > ACTION_SIZE else ()

    def reset(self, seed: Any = None) -> np.ndarray:
        if seed is not None:
            self.view.seed(seed)
        return self.view.reset()

    def step(self, actions: Any) -> Shown:
        observations, rewards, over, infos = self.view.step(actions)
        handed = [observations, rewards, over]
        if not over.any():
            return Shown(observations, rewards, over, False, None, tuple(handed))
        handed += [info["terminal_observation"] for info in infos]
        names = [f"{side}_return" for side in self.sides] or ["r"]
        returns = np.array([[info["episode"][name] for name in names] for info in infos])
        ended = not all(info["TimeLimit.truncated"] for info in infos)
        last = np.array(handed[3:])
        return Shown(last, rewards, over, ended, returns.reshape(rewards.shape), tuple(handed))

    def next_round(self) -> None:
        """It has begun."""


class _DuelHands(Hands):
    """N games of both sides."""

    sides = SIDES

    def __init__(self, view: Any) -> None:
        super().__init__(view)
        self.games = view.count
        self.shape = (self.games, ACTION_SIZE)

    def _duel(self) -> Duel:
        return self.view

    def spaces(self) -> tuple[Any, ...]:
        """A duel has none."""
        return ()

    def holds(self, observations: np.ndarray) -> bool:
        """Whether all numbers are in [-1, 1]."""
        return bool((np.abs(observations) <= 1).all()) and observations.dtype == np.float32

    def reset(self, seed: Any = None) -> np.ndarray:
        """See :class:`Hands`; without a seed one of chance, as a duel has to be told."""
        self.view.reset(seeds=int(np.random.default_rng().integers(2**40)) if seed is None else seed)
        return self._both(self.view.present())

    def step(self, actions: Any) -> Shown:
        step = self.view.step(*actions)
        rewards = np.column_stack([step.ally_rewards, step.opponent_rewards])
        handed = (*step, self.view.state())
        return Shown(self._both(step), rewards, step.truncated, False, self._returns(step.truncated), handed)

    def _returns(self, over: np.ndarray) -> np.ndarray | None:
        if not over.any():
            return None
        measures = [self.view.measures(game) for game in range(self.games)]
        return np.array([[found[f"{side}_return"] for side in SIDES] for found in measures])

    @staticmethod
    def _both(step: Any) -> np.ndarray:
        return np.hstack([step.ally_observations, step.opponent_observations])

    def packed(self, actions: np.ndarray) -> Any:
        return actions[:, :ACTION_SIZE].copy(), actions[:, ACTION_SIZE:].copy()


class _PettingZooHands(Hands):
    """One game of both sides by PettingZoo, moving at once."""

    sides = SIDES

    def _duel(self) -> Duel:
        return self.view.duel

    def spaces(self) -> tuple[Any, ...]:
        view = self.view
        return tuple(space(side) for side in SIDES for space in (view.observation_space, view.action_space))

    def holds(self, observations: np.ndarray) -> bool:
        parts = zip(SIDES, np.split(observations[0], 2), strict=True)
        return all(part in self.view.observation_space(side) for side, part in parts)

    def reset(self, seed: Any = None) -> np.ndarray:
        return self._row(self.view.reset(seed=seed)[0])

    def step(self, actions: Any) -> Shown:
        observations, rewards, terminated, over, infos = self.view.step(actions)
        handed = (*observations.values(), self.view.state())
        ended = np.array([all(over.values())])
        measures = [infos[side].get("measures") for side in SIDES]
        known = [found[f"{side}_return"] for side, found in zip(SIDES, measures, strict=True) if found]
        returns = np.array([known]) if known else None
        earned = self._row({side: np.array([reward]) for side, reward in rewards.items()})
        return Shown(self._row(observations), earned, ended, any(terminated.values()), returns, handed)

    @staticmethod
    def _row(found: dict[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([found[side] for side in SIDES])[None]

    def packed(self, actions: np.ndarray) -> Any:
        parts = np.split(actions[0].copy(), 2)
        return dict(zip(SIDES, parts, strict=True))


_KINDS = (
    ("gymnasium", "Env", _SingleHands),
    ("gymnasium.vector", "VectorEnv", _VectorHands),
    ("stable_baselines3.common.vec_env", "VecEnv", _SB3Hands),
    ("pettingzoo", "ParallelEnv", _PettingZooHands),
)


def hands_of(view: Any) -> Hands:
    """The view in one's hands, its wrappers taken off.

    Raises:
        UserError: a view of no kind that is known.
    """
    view = getattr(view, "unwrapped", view)
    if isinstance(view, Duel):
        return _DuelHands(view)
    for module, name, hands in _KINDS:  # what was never imported made no view
        if module in sys.modules and isinstance(view, getattr(sys.modules[module], name)):
            return hands(view)
    raise UserError(f"view: expected one of Gymnasium, SB3 or PettingZoo, or a duel, got {view!r}")
