"""The PettingZoo environment, by PettingZoo's own tests and the game's contract."""

from __future__ import annotations

import warnings

import numpy as np
import pettingzoo
import pytest

with warnings.catch_warnings():  # importing PettingZoo's tests warns of PettingZoo's own games
    warnings.simplefilter("ignore")
    from pettingzoo.test import api_test, parallel_api_test, seed_test

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ALLY_MODES, action_modes
from fpg_bench.envs.pettingzoo_env import aec_env, parallel_env
from fpg_bench.game.scenario import as_scenario

from .playing import SHORT, STEPS, tape

# PettingZoo would like agents to be named player_0 and the like, and no MultiDiscrete
pytestmark = pytest.mark.filterwarnings(
    "error", "ignore:We recommend agents to be named", "ignore:Action space for each agent probably should be"
)


def registered(kind, **options):
    options = {"scenario": SHORT, **options}
    if not hasattr(pettingzoo, "make"):  # before 1.27
        return {"parallel": parallel_env, "aec": aec_env}[kind](**options)
    return pettingzoo.make(kind, "FPG/duel_v0", **options)


MASKED = as_scenario(SHORT, knowledge="none", jamming_types=("tone",))


@pytest.mark.parametrize("scenario", [SHORT, MASKED], ids=["all", "masked"])
@pytest.mark.parametrize(
    "actions",
    [
        *action_modes("opponent"),
        *({"ally": mode} for mode in ("discrete", *ALLY_MODES)),
        {"opponent": "multi-discrete"},
    ],
)
def test_pettingzoo_finds_nothing_amiss(actions, scenario):
    options = {"actions": actions, "scenario": scenario}
    if scenario is SHORT:  # this test knows no masks in infos
        parallel_api_test(registered("parallel", **options), 3 * STEPS)
    api_test(registered("aec", **options), 3 * STEPS)
    seed_test(lambda: aec_env(**options), 2 * STEPS)


@pytest.mark.parametrize("actions", ["discrete", "multi-discrete"])
def test_masks_are_what_the_action_spaces_sample_with(actions):
    env = registered("parallel", actions=actions, scenario=MASKED)
    _, infos = env.reset(seed=0)
    for _ in range(STEPS):
        sampled = {side: env.action_space(side).sample(info["action_mask"]) for side, info in infos.items()}
        *_, infos = env.step(sampled)
    assert "measures" in infos["ally"]


@pytest.mark.parametrize("bad", [None, 5, [], {}, {"ally": [10**400] * 9}, {"ally": None, "opponent": None}])
def test_anything_but_a_mapping_of_actions_is_refused_in_one_line(bad):
    env = registered("parallel")
    env.reset(seed=0)
    with pytest.raises(UserError, match=r"^(ally|step: actions by agent): expected"):
        env.step(bad)


def test_a_step_of_nobody_after_the_end_is_empty_as_black_death_asks():
    supersuit = pytest.importorskip("supersuit")
    env = supersuit.black_death_v3(registered("parallel"))
    for _ in range(2):
        env.reset(seed=0)
        steps = 0
        while env.agents:
            env.step({side: tape(1, 1)[0, 0] for side in env.agents})
            steps += 1
        assert steps == STEPS + 1  # SuperSuit notices a time limit in the step after it
    game = env.unwrapped
    assert game.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(UserError, match="call reset first"):
        game.step(dict.fromkeys(("ally", "opponent"), tape(1, 1)[0, 0]))
    with pytest.raises(UserError, match="call reset first"):
        registered("parallel").step({})


def test_taking_turns_is_the_same_game():
    together, turns = registered("parallel"), registered("aec")
    together.reset(seed=4)
    turns.reset(seed=4)
    for ally, opponent in zip(tape(1, STEPS)[:, 0], tape(1, STEPS, seed=1)[:, 0], strict=True):
        observations, rewards, *_ = together.step({"ally": ally, "opponent": opponent})
        turns.step(ally)
        turns.step(opponent)
        for side in observations:
            assert np.array_equal(turns.observe(side), observations[side])
            assert turns.rewards[side] == rewards[side]
    assert all(turns.truncations.values())


def test_the_state_is_the_full_state():
    env = registered("parallel")
    observations, _ = env.reset(seed=0)
    state = env.state()
    assert state in env.state_space
    assert np.array_equal(state[:15], observations["ally"])
    assert np.array_equal(state[15:30], observations["opponent"])
    observations["ally"][:] = 5
    assert np.array_equal(env.state(), state)
