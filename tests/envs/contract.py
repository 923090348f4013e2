"""The contract of all environments: one adapter per library, and one check per promise."""

from __future__ import annotations

import copy
import pickle
from functools import partial
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pettingzoo
import pytest
from stable_baselines3.common.vec_env import VecEnv

from fpg_bench.common.errors import UserError
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.player import SIDES

SEED = 5


class Step(NamedTuple):
    """A step of N games, by one set of names.

    Attributes:
        observations: ``(N, 15)`` of one side, ``(N, 30)`` of both; at a round's end those of its last step.
        rewards: ``(N,)`` of one side, ``(N, 2)`` of both.
        over: ``(N,)`` bool, rounds that ended by truncation.
        terminated: whether any game ended otherwise.
        returns: like ``rewards``, the rounds' returns in the measures; None before their end.
        handed: the very arrays that the environment returned.
    """

    observations: np.ndarray
    rewards: np.ndarray
    over: np.ndarray
    terminated: bool
    returns: np.ndarray | None
    handed: tuple[np.ndarray, ...]


class Adapter:
    """One interface to N games of one side or of both.

    ``shape`` is that of one side's actions; ``width`` counts a game's actions of all sides.
    """

    sides: tuple[str, ...] = ()

    def __init__(self, env):
        self.env, self.games, self.shape = env, 1, (ACTION_SIZE,)
        self.scenario = self.duel().scenario

    def duel(self):
        return self.env.core.duel

    @property
    def width(self):
        return ACTION_SIZE * len(self.sides or (1,))

    def spaces(self):
        return self.env.observation_space, self.env.action_space

    def holds(self, observations):
        return all(row in self.env.observation_space for row in observations)

    def pack(self, actions):
        """Actions ``(N, width)`` as the environment takes them."""
        return actions

    def next_round(self):
        """Begin the next round where the environment does not by itself."""
        self.env.reset()


class SingleAdapter(Adapter):
    """One game by Gymnasium."""

    def reset(self, seed=None):
        return self.env.reset(seed=seed)[0][None]

    def step(self, actions):
        observation, reward, terminated, truncated, info = self.env.step(actions)
        measures = info.get("measures")
        returns = None if measures is None else np.array([measures[f"{self.env.core.side}_return"]])
        over = np.array([truncated])
        return Step(observation[None], np.array([reward]), over, terminated, returns, (observation,))

    def pack(self, actions):
        return actions[0].copy()


class VectorAdapter(Adapter):
    """N games by Gymnasium, which begin their next round in a step of its own."""

    def __init__(self, env):
        super().__init__(env)
        self.games, self.shape = env.num_envs, (env.num_envs, ACTION_SIZE)

    def spaces(self):
        return (*super().spaces(), self.env.single_observation_space)

    def holds(self, observations):
        return observations in self.env.observation_space

    def reset(self, seed=None):
        return self.env.reset(seed=seed)[0]

    def step(self, actions):
        observations, rewards, terminated, over, infos = self.env.step(actions)
        measures = infos.get("measures")
        returns = None if measures is None else measures[f"{self.env.core.side}_return"]
        handed = (observations, rewards, terminated, over)
        return Step(observations, rewards, over, terminated.any(), returns, handed)

    def next_round(self):
        self.env.step(np.zeros(self.shape, np.float32))


class SB3Adapter(Adapter):
    """N games by Stable-Baselines3, of one side or of both, which begin their next round at once."""

    def __init__(self, env):
        super().__init__(env)
        self.games, self.shape = env.num_envs, (env.num_envs, *env.action_space.shape)
        self.sides = SIDES if env.action_space.shape[0] > ACTION_SIZE else ()

    def reset(self, seed=None):
        if seed is not None:
            self.env.seed(seed)
        return self.env.reset()

    def step(self, actions):
        observations, rewards, over, infos = self.env.step(actions)
        handed = (observations, rewards, over)
        if not over.any():
            return Step(observations, rewards, over, False, None, handed)
        last = [info["terminal_observation"] for info in infos]
        names = [f"{side}_return" for side in self.sides] or ["r"]
        returns = np.array([[info["episode"][name] for name in names] for info in infos])
        ended = not all(info["TimeLimit.truncated"] for info in infos)
        return Step(np.array(last), rewards, over, ended, returns.reshape(rewards.shape), (*handed, *last))

    def next_round(self):
        """It has begun."""


class DuelAdapter(Adapter):
    """N games of both sides."""

    sides = SIDES

    def __init__(self, env):
        super().__init__(env)
        self.games, self.shape = env.count, (env.count, ACTION_SIZE)

    def duel(self):
        return self.env

    def spaces(self):
        return ()

    def holds(self, observations):
        return bool((np.abs(observations) <= 1).all()) and observations.dtype == np.float32

    def reset(self, seed=None):  # a duel must be given a seed
        self.env.reset(seeds=int(np.random.default_rng().integers(2**40)) if seed is None else seed)
        return self._both(self.env.present())

    def step(self, actions):
        step = self.env.step(*actions)
        rewards = np.column_stack([step.ally_rewards, step.opponent_rewards])
        returns = None
        if step.truncated.any():
            measures = [self.env.measures(game) for game in range(self.games)]
            returns = np.array([[each[f"{side}_return"] for side in SIDES] for each in measures])
        handed = (*step, self.env.state())
        return Step(self._both(step), rewards, step.truncated, False, returns, handed)

    @staticmethod
    def _both(step):
        return np.hstack([step.ally_observations, step.opponent_observations])

    def pack(self, actions):
        return actions[:, :ACTION_SIZE].copy(), actions[:, ACTION_SIZE:].copy()


class ParallelAdapter(Adapter):
    """One game of both sides by PettingZoo."""

    sides = SIDES

    def duel(self):
        return self.env.duel

    def spaces(self):
        return tuple(of(side) for side in SIDES for of in (self.env.observation_space, self.env.action_space))

    def holds(self, observations):
        parts = zip(SIDES, np.split(observations[0], 2), strict=True)
        return all(part in self.env.observation_space(side) for side, part in parts)

    def reset(self, seed=None):
        return self._row(self.env.reset(seed=seed)[0])

    def step(self, actions):
        observations, rewards, terminated, over, infos = self.env.step(actions)
        handed = (*observations.values(), self.env.state())
        measures = {side: infos[side].get("measures") for side in SIDES}
        returned = [each[f"{side}_return"] for side, each in measures.items() if each]
        returns = np.array([returned]) if returned else None
        earned = self._row({side: np.array([reward]) for side, reward in rewards.items()})
        ended = np.array([all(over.values())])
        return Step(self._row(observations), earned, ended, any(terminated.values()), returns, handed)

    @staticmethod
    def _row(by_side):
        return np.concatenate([by_side[side] for side in SIDES])[None]

    def pack(self, actions):
        return dict(zip(SIDES, np.split(actions[0].copy(), 2), strict=True))


_ADAPTERS = {
    TwoPlayerBatch: DuelAdapter,
    gymnasium.Env: SingleAdapter,
    gymnasium.vector.VectorEnv: VectorAdapter,
    VecEnv: SB3Adapter,
    pettingzoo.ParallelEnv: ParallelAdapter,
}


def adapt(env):
    env = getattr(env, "unwrapped", env)
    return next(adapter(env) for kind, adapter in _ADAPTERS.items() if isinstance(env, kind))


def _actions(adapter, steps, first=0):
    """Uniform actions ``(steps, games, width)``, a stream for each game; ``first``: the first game's."""
    streams = [np.random.default_rng(first + game) for game in range(adapter.games)]
    rows = [rng.uniform(-1, 1, (steps, adapter.width)) for rng in streams]
    return np.stack(rows, axis=1).astype(np.float32)


def play(adapter, seed, rounds=2, first=0):
    """All observations and rewards of some rounds."""
    shown = [adapter.reset(seed).copy()]
    for actions in _actions(adapter, rounds * adapter.scenario.steps_per_round, first):
        step = adapter.step(adapter.pack(actions))
        shown += [step.observations.copy(), step.rewards.copy()]
        if step.over.all():
            adapter.next_round()
    return shown


def _same(first, second):
    return all(np.array_equal(x, y) for x, y in zip(first, second, strict=True))


def _round(adapter):
    return [adapter.step(adapter.pack(a)) for a in _actions(adapter, adapter.scenario.steps_per_round)]


def check_spaces(make):
    """All that is shown lies in the spaces, which are always the same objects."""
    adapter = adapt(make())
    shown = [adapter.reset(SEED), *(step.observations for step in _round(adapter))]
    outside = next((k for k, observations in enumerate(shown) if not adapter.holds(observations)), None)
    assert outside is None, f"the observations of step {outside} are not in their space"
    same = all(x is y for x, y in zip(adapter.spaces(), adapter.spaces(), strict=True))
    assert same, "a space is made anew where it is asked for; keep it"


def check_seeds(make):
    """The same seed gives the same game, another seed another one, and none one by chance."""
    first = play(adapt(make()), SEED)
    for seed in (SEED, np.int32(SEED), np.uint64(SEED), np.array(SEED)):
        assert _same(first, play(adapt(make()), seed)), f"the same seed gave another game: {seed!r}"
    other = play(adapt(make()), SEED + 100, rounds=1)
    assert not _same(first[: len(other)], other), "another seed gave the same game"
    here, there = (adapt(make()).reset() for _ in range(2))
    assert not np.array_equal(here, there), "without a seed two games are the same"


def check_rounds(make):
    """A round ends by truncation with its last step and no other, which says what it has earned."""
    adapter = adapt(make())
    adapter.reset(SEED)
    for _ in range(2):
        earned: Any = 0
        for k, step in enumerate(_round(adapter), start=1):
            last = k == adapter.scenario.steps_per_round
            earned = earned + step.rewards.astype(float)
            assert not step.terminated, f"a game was terminated in step {k}; rounds are truncated"
            assert step.over.all() == step.over.any() == last, f"not all rounds end at once in step {k}"
            assert (step.returns is not None) == last, f"measures belong to a round's last step, {k=}"
        near = np.allclose(np.asarray(step.returns, float), earned, rtol=1e-4, atol=1e-3)
        assert near, f"a round earned {earned.tolist()}, but its measures say {step.returns}"
        adapter.next_round()


def check_arrays(make):
    """Arrays belong to the caller: writing into them changes no game, and they are never written again."""
    spoilt, clean = adapt(make()), adapt(make())
    spoilt.reset(SEED)[...] = 7
    clean.reset(SEED)
    kept = []
    for actions in _actions(clean, clean.scenario.steps_per_round + 2):
        here, there = spoilt.step(spoilt.pack(actions)), clean.step(clean.pack(actions))
        assert _same(here.handed, there.handed), "writing into what was handed out changed it"
        kept += [(array, array.copy()) for array in there.handed]
        for array in here.handed:
            array[...] = 1
        if there.over.all():
            spoilt.next_round()
            clean.next_round()
    assert all(np.array_equal(*pair) for pair in kept), "an array was written again; hand out copies"


def check_actions(make):
    """Actions are left as they were."""
    adapter = adapt(make())
    adapter.reset(SEED)
    actions = adapter.pack(np.full((adapter.games, adapter.width), 3.0, np.float32))
    before = copy.deepcopy(actions)
    adapter.step(actions)
    assert _same(_arrays(actions), _arrays(before)), "it changed its actions; work on a copy"


def _arrays(actions):
    parts = actions.values() if isinstance(actions, dict) else actions
    return [actions] if isinstance(actions, np.ndarray) else list(parts)


def check_copies(make):
    """A pickled copy, made in the middle of a round, plays on alone, into the next round."""
    adapter = adapt(make())
    adapter.reset(SEED)
    first, *rest = _actions(adapter, adapter.scenario.steps_per_round + 2)
    adapter.step(adapter.pack(first))
    twin = adapt(pickle.loads(pickle.dumps(adapter.env)))
    for actions in rest:
        here, there = (each.step(each.pack(actions)) for each in (adapter, twin))
        assert _same(here.handed, there.handed), "a copy plays another game"
        if here.over.all():
            adapter.next_round()
            twin.next_round()


def _refused(call, *parts):
    """Assert that a call is refused in one line that holds these parts."""
    with pytest.raises(UserError) as refused:
        call()
    message = str(refused.value)
    assert all(part in message for part in parts), (message, parts)


def check_first_reset(make):
    """Playing before the first reset is refused."""
    adapter = adapt(make())
    actions = adapter.pack(np.zeros((adapter.games, adapter.width), np.float32))
    _refused(partial(adapter.step, actions), "reset")


def check_bad_actions(make):
    """Actions that are not finite are refused by their game, side and index, others by their shape."""
    adapter = adapt(make())
    adapter.reset(SEED)
    zeros = np.zeros((adapter.games, adapter.width), np.float32)
    game = f" of game {adapter.games - 1}" if adapter.games > 1 else ""
    side = adapter.sides[-1] if adapter.sides else adapter.env.core.side
    for bad in (np.nan, np.inf, -np.inf):
        actions = zeros.copy()
        actions[-1, -2] = bad
        _refused(partial(adapter.step, adapter.pack(actions)), f"{side} action{game}: index 7 is {bad}")
    for spoil in (lambda part: part[..., :-1], lambda part: part.astype(int), lambda part: part[None]):
        actions = _spoilt(adapter.pack(zeros), spoil)
        _refused(partial(adapter.step, actions), f"float array of shape {adapter.shape}, got ")


def _spoilt(actions, spoil):
    """Actions of which the last side's part is spoilt."""
    if isinstance(actions, dict):
        last = list(actions)[-1]
        return actions | {last: spoil(actions[last])}
    return (actions[0], spoil(actions[1])) if isinstance(actions, tuple) else spoil(actions)


def check_bad_seeds(make):
    """A seed is a whole number from 0 on."""
    for seed in ("7", 1.5, True, -1, 2**63, 10**5000, np.array(1.5)):
        _refused(partial(adapt(make()).reset, seed), "expected")


CHECKS = {
    "spaces": check_spaces,
    "seeds": check_seeds,
    "rounds": check_rounds,
    "arrays": check_arrays,
    "actions": check_actions,
    "copies": check_copies,
    "first reset": check_first_reset,
    "bad actions": check_bad_actions,
    "bad seeds": check_bad_seeds,
}
