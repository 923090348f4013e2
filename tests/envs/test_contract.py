"""All environments keep one contract, and its checks find what breaks it."""

from __future__ import annotations

from functools import partial

import gymnasium
import numpy as np
import pytest

from fpg_bench import make_duel, make_sb3
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.envs.sb3_vec_env import make_sb3_duel

from .contract import CHECKS
from .playing import ALLY, IDS, SHORT

GAMES = 3
ENVS = {
    **{f"single {name}": partial(gymnasium.make, name, scenario=SHORT) for name in IDS},
    **{f"batch {name}": partial(gymnasium.make_vec, name, GAMES, scenario=SHORT) for name in IDS},
    **{f"sb3 {name}": partial(make_sb3, name, GAMES, scenario=SHORT) for name in IDS},
    "sb3 of both sides": partial(make_sb3_duel, GAMES, scenario=SHORT),
    "duel": partial(make_duel, GAMES, scenario=SHORT),
    "duel with a planner": partial(make_duel, GAMES, scenario=SHORT, planner="random"),
    "pettingzoo": partial(parallel_env, scenario=SHORT),
}


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("kind", ENVS)
def test_the_contract_holds(kind, check):
    CHECKS[check](ENVS[kind])


# A env of one game that is spoilt in one place; ``sound`` is what it did before


def _too_wide(env, sound):
    def step(action):
        observation, *rest = sound.step(action)
        return observation + 1.5, *rest

    env.step = step


def _deaf(env, sound):
    env.reset = lambda seed=None, options=None: sound.reset(seed=3)


def _terminating(env, sound):
    def step(action):
        observation, reward, _, over, info = sound.step(action)
        return observation, reward, over, False, info

    env.step = step


def _mistaken(env, sound):
    def step(action):
        observation, reward, *rest = sound.step(action)
        return observation, 2 * reward, *rest

    env.step = step


def _lending(env, sound):
    env.step = lambda action: (env.core.observations[0], *sound.step(action)[1:])


def _clipping(env, sound):
    env.step = lambda action: sound.step(np.clip(action, -1, 1, out=action))


def _uncopied(env, sound):
    env.__deepcopy__ = lambda memory: begun(8)


def _eager(env, sound):
    def step(action):
        if not env._begun:
            env.reset()
        return sound.step(action)

    env.step = step


def _tolerant(env, sound):
    env.step = lambda action: sound.step(np.nan_to_num(action))


def _rounding(env, sound):
    env.reset = lambda seed=None, options=None: sound.reset(
        seed=None if seed is None else abs(int(seed)) % 99
    )


def begun(seed):
    env = gymnasium.make(ALLY, scenario=SHORT).unwrapped
    env.reset(seed=seed)
    return env


class Sound:
    """The methods of a env as they were."""

    def __init__(self, env):
        self.reset, self.step = env.reset, env.step


def spoilt(spoil):
    def make():
        env = gymnasium.make(ALLY, scenario=SHORT).unwrapped
        spoil(env, Sound(env))
        return env

    return make


@pytest.mark.parametrize(
    ("spoil", "check", "message"),
    [
        (_too_wide, "spaces", "observations of step 1 are not in their space"),
        (_deaf, "seeds", "another seed gave the same game"),
        (_terminating, "rounds", "a game was terminated in step 32; rounds are truncated"),
        (_mistaken, "rounds", "a round earned .*, but its measures say"),
        (_lending, "arrays", "hand out copies"),
        (_clipping, "actions", "it changed its actions; work on a copy"),
        (_uncopied, "copies", "a copy plays another game"),
        (_eager, "first reset", "nothing was refused; expected a UserError that says reset"),
        (_tolerant, "bad actions", "expected a UserError that says ally action: index 7 is nan"),
        (_rounding, "bad seeds", "nothing was refused"),
    ],
)
def test_each_fault_is_found_by_its_check(spoil, check, message):
    with pytest.raises(AssertionError, match=message) as caught:
        CHECKS[check](spoilt(spoil))
    assert "\n" not in str(caught.value)


def test_games_of_a_batch_must_be_those_of_their_seeds():
    def make():
        env = gymnasium.make_vec(ALLY, GAMES, scenario=SHORT).unwrapped
        sound = env.reset
        env.reset = lambda seed=None, options=None: sound(seed=None if seed is None else [seed, 0, seed + 2])
        return env

    with pytest.raises(AssertionError, match="game i of a batch of seed s is not game i - 1 of seed s"):
        CHECKS["batch"](make)
