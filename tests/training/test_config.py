"""The configuration of a run, before anything is made from it."""

import dataclasses
import pickle

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.training.config import GameOptions, RunConfig
from tests.training.tiny import run_config

ALLY, POLICY, DUEL = "FPG/AllyVsScripted-v0", "FPG/OpponentVsPolicy-v0", "FPG/duel_v0"


def test_a_configuration_is_a_value():
    config = RunConfig("ppo", ALLY, seed=3, game=GameOptions(path="circle", knowledge="none"))
    assert pickle.loads(pickle.dumps(config)) == config
    assert dataclasses.replace(config, seed=4).game == config.game
    assert config.game_options() == {"path": "circle", "knowledge": "none"}
    with pytest.raises(UserError, match="here: unknown key 'pth'; did you mean 'path'"):
        GameOptions.parse({"pth": "circle"}, "here")


def test_the_other_side_is_named_once():
    assert run_config("ppo", POLICY, against="expert", path="learned").game_options() == {
        "path": "learned",
        "ally": "expert",
    }
    with pytest.raises(UserError, match="against: names the ally, and so does ally"):
        run_config("ppo", POLICY, against="expert", ally="idle").game_options()
    with pytest.raises(UserError, match="both sides learn; name nobody"):
        run_config("maddpg", DUEL, against="expert").game_options()


def test_each_side_of_a_duel_has_a_suite_of_its_own():
    assert RunConfig("maddpg", DUEL).suites() == ["ally-v1", "opponent-v1"]
    assert run_config("ppo", POLICY, path="learned").suites() == ["opponent-learned-v1"]
    assert RunConfig("ppo", ALLY, suite="mine.yml").suites() == ["mine.yml"]
    with pytest.raises(UserError, match="suite: each side of FPG/duel_v0 is scored by its own"):
        RunConfig("maddpg", DUEL, suite="ally-v1").suites()


def test_the_options_are_those_of_the_command_line():
    config = run_config("ppo", POLICY, against=["a", "b"], start="run", llm={"deadline_s": 3}, reward=None)
    assert config.options() == {"ally": ["a", "b"], "start": "run", "deadline": 3}
