"""What a training run is, before anything is made of it."""

import dataclasses
import pickle

import pytest

from fpg_bench.errors import UserError
from fpg_bench.training.spec import RunSpec

ALLY, POLICY, DUEL = "FPG/AllyVsScripted-v0", "FPG/OpponentVsPolicy-v0", "FPG/duel_v0"


def test_words_that_are_no_runs_are_options_of_its_games():
    spec = RunSpec.of("ppo", ALLY, seed=3, steps=100, path="circle", knowledge="none")
    assert (spec.seed, spec.steps, spec.options) == (3, 100, {"path": "circle", "knowledge": "none"})
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert dataclasses.replace(spec, seed=4).options == spec.options


def test_the_other_side_is_named_once():
    assert RunSpec.of("ppo", POLICY, against="expert", path="learned").games() == {
        "path": "learned",
        "ally": "expert",
    }
    with pytest.raises(UserError, match="against: names the ally, and so does ally"):
        RunSpec.of("ppo", POLICY, against="expert", ally="idle").games()
    with pytest.raises(UserError, match="both sides learn; name nobody"):
        RunSpec.of("maddpg", DUEL, against="expert").games()


def test_each_side_of_a_duel_has_a_field_of_its_own():
    assert RunSpec("maddpg", DUEL).fields() == ["ally-v1", "opponent-v1"]
    assert RunSpec.of("ppo", POLICY, path="learned").fields() == ["opponent-learned-v1"]
    assert RunSpec("ppo", ALLY, field="mine.yml").fields() == ["mine.yml"]
    with pytest.raises(UserError, match="field: each side of FPG/duel_v0 is scored by its own"):
        RunSpec("maddpg", DUEL, field="ally-v1").fields()


def test_all_that_was_said_is_told():
    spec = RunSpec.of("ppo", POLICY, against=["a", "b"], start="run", llm={"deadline_s": 3}, reward=None)
    assert spec.told() == {"ally": ["a", "b"], "start": "run", "deadline": 3}
