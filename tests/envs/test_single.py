"""The Gymnasium environment of one game: its keywords and bad input."""

from __future__ import annotations

import dataclasses
from functools import cache

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeAwareObservation

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD

from .playing import ALLY, ALLY_POLICY, OPPONENT, OPPONENT_POLICY, PLANNED, REST, SHORT, STEPS, tape


def test_a_spec_makes_the_same_environment_again():
    env = gymnasium.make(ALLY, opponent=["tone", "comb"], path="circle", scenario=SHORT)
    twin = gymnasium.make(env.spec)
    assert twin.unwrapped.core.other_specs == ["tone", "comb"]
    assert twin.unwrapped.core.scenario == env.unwrapped.core.scenario


def test_the_radio_of_a_step_is_in_the_info_of_the_model_link_alone():
    for scenario, expected in (("link", {"snr_db", "rate_mbit_s", "covered"}), ("standard", set())):
        env = gymnasium.make(ALLY, scenario=scenario)
        assert set(env.reset(seed=0)[1]) == expected
        seen, *_, info = env.step(env.action_space.sample())
        assert set(info) == expected | {"advice"}
        if expected:
            assert type(info["covered"]) is bool
            assert info["snr_db"] / 40 == pytest.approx(float(seen[8]), abs=1e-6)


def test_the_ally_is_shown_what_the_knowledge_base_advises_and_the_opponent_is_not():
    env, other = gymnasium.make(ALLY, opponent="broadband"), gymnasium.make(OPPONENT)
    assert "advice" not in env.reset(seed=0)[1]
    other.reset(seed=0)
    advice = {env.step(REST)[4]["advice"] for _ in range(20)}
    assert all(isinstance(words, str) for words in advice)
    assert "advice" not in other.step(REST)[4]
    unadvised = gymnasium.make(ALLY, knowledge="none")
    unadvised.reset(seed=0)
    assert "advice" not in unadvised.step(REST)[4]


def test_a_new_match_can_be_asked_for_and_is_the_one_that_would_have_come():
    early, patient = (gymnasium.make(ALLY, scenario=SHORT) for _ in range(2))
    for env in (early, patient):
        env.reset(seed=9)
    first = early.reset(options={"new_match": True})[0]
    patient.reset()
    assert np.array_equal(first, patient.reset()[0])
    same_match = patient.reset(options={"new_match": False})[0]
    assert not np.array_equal(first, same_match)
    with pytest.raises(UserError, match="unknown option 'newmatch'; known: new_match"):
        early.reset(options={"newmatch": True})


CHANGES = [
    (ALLY, {"scenario": "paper"}),
    (ALLY, {"scenario": dataclasses.replace(STANDARD, hop_cost=1)}),
    (ALLY, {"opponent": "broadband"}),
    (ALLY, {"opponent": ["tone", "comb"]}),
    (ALLY, {"path": "circle"}),
    (ALLY, {"path": ["triangle", "rectangle"]}),
    (ALLY, {"jamming_types": ["comb"]}),
    (ALLY, {"reward": "zero_sum"}),
    (PLANNED, {"planner": "rectangle"}),
    (PLANNED, {"opponent": "tone"}),
    (PLANNED, {"path": ["waypoints", "pursuit"]}),
    (OPPONENT, {"ally": "always-hop"}),
    (OPPONENT, {"path": "learned"}),
    (OPPONENT, {"knowledge": "none"}),
    (ALLY_POLICY, {"opponent": "oracle"}),
    (OPPONENT_POLICY, {"ally": "oracle"}),
]


def rewards_of(env):
    """The rewards of three rounds of 60 steps, the gates of both sides' actions in use."""
    env.reset(seed=2)
    rewards = []
    for k, action in enumerate(tape(1, 180)[:, 0]):
        rewards.append(env.step(action)[1])
        if k % 60 == 59:
            env.reset()
    return rewards


@cache
def plain_rewards(env_id):
    return rewards_of(gymnasium.make(env_id, disable_env_checker=True))


@pytest.mark.parametrize(("env_id", "options"), CHANGES)
def test_every_keyword_changes_the_outcome(env_id, options):
    assert plain_rewards(env_id) != rewards_of(gymnasium.make(env_id, disable_env_checker=True, **options))


def test_threads_change_nothing():
    env = gymnasium.make(ALLY, threads=2, disable_env_checker=True)
    assert env.unwrapped.core.duel.batch.threads == 2
    assert rewards_of(env) == plain_rewards(ALLY)


class Copycat:
    """A player of one's own: does to the ally what its own observation says."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return observation[:, :9].copy(), None


@pytest.mark.parametrize(
    "spec", ["adaptive", "oracle", Copycat(), f"{__name__}:Copycat", ["tone", Copycat()]]
)
def test_a_policy_environment_takes_a_script_an_oracle_an_object_and_a_list(spec):
    env = gymnasium.make(ALLY_POLICY, opponent=spec, scenario=SHORT)
    env.reset(seed=0)
    for action in tape(1, STEPS)[:, 0]:
        *_, truncated, _ = env.step(action)
    assert truncated


MISTAKES = [
    (ALLY, {"opponent": "oracle"}, "FPG/AllyVsPolicy-v0 plays against anyone"),
    (ALLY, {"opponent": 3}, "opponent: 3 is not a script"),
    (ALLY, {"ally": "expert"}, "you play the ally; name the opponent"),
    (OPPONENT, {"opponent": "tone"}, "you play the opponent; name the ally"),
    (ALLY, {"path": "persuit"}, "did you mean 'pursuit'"),
    (ALLY, {"path": "waypoints"}, "plans no 'waypoints'; FPG/AllyVsPlanner-v0 does"),
    (PLANNED, {"path": "circle"}, "choose a planner instead"),
    (PLANNED, {"path": 3}, "choose a planner instead"),
    (ALLY, {"planner": "circle"}, "plans no paths; FPG/AllyVsPlanner-v0 does"),
    (ALLY, {"actions": "Discrete"}, "did you mean 'discrete'"),
    ("FPG/AllyVsScriptedDiscrete-v0", {"actions": "continuous"}, "the id says discrete"),
    (ALLY, {"reward": "jaming"}, "reward: expected one of own, zero_sum.*'jaming'.*jamming"),
]


@pytest.mark.parametrize(("env_id", "options", "message"), MISTAKES)
def test_a_mistaken_keyword_is_refused_in_one_line(env_id, options, message):
    with pytest.raises(UserError, match=message):
        gymnasium.make(env_id, **options)


def test_the_spec_says_how_long_a_round_is():
    env = TimeAwareObservation(gymnasium.make(ALLY, scenario=SHORT), normalize_time=False)
    assert env.spec.max_episode_steps == STEPS
    env.reset(seed=0)
    assert env.step(REST)[0][-1] == 1
    again = gymnasium.make(env.unwrapped.spec)
    again.reset(seed=0)
    assert [again.step(REST)[3] for _ in range(STEPS)] == [False] * (STEPS - 1) + [True]
    with pytest.raises(UserError, match="the round is over; call reset first"):
        again.step(REST)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.zeros((1, 8), np.float32), r"answered with actions of shape \(1, 8\), expected \(1, 9\)"),
        ([[0.0] * 9], "of shape list"),
        (np.full((1, 9), np.nan, np.float32), "opponent action: index 0 is nan"),
    ],
)
def test_a_player_that_answers_amiss_is_named(answer, message):
    class Wrong:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return answer, None

    env = gymnasium.make(ALLY_POLICY, opponent=Wrong()).unwrapped
    env.reset(seed=0)
    with pytest.raises(UserError, match=message):
        env.step(REST)
