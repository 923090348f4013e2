"""What the name of an algorithm means, and algorithms of one's own."""

import json

import numpy as np
import pytest
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL
from fpg_bench.players.agent import load_agent
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_games, make_model
from fpg_bench.training.tuning.space import load_space
from tests.training.own import Mine
from tests.training.tiny import ALLY, train, train_tiny


@pytest.mark.parametrize(
    ("name", "kind", "frames"),
    [
        ("ppo", PPO, None),
        ("ppo-fast", PPO, None),
        ("sac", SAC, None),
        ("td3-stack4", TD3, 4),
        ("ppo-stack8", PPO, 8),
        ("recurrent-ppo", RecurrentPPO, None),
        ("sb3_contrib:TQC", TQC, None),
        (PPO, PPO, None),
    ],
)
def test_names(name, kind, frames):
    found = find_algorithm(name)
    assert (found.kind, found.frame_stack) == (kind, frames)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pppo", "did you mean 'ppo'"),
        ("recurrent_ppo", "did you mean 'recurrent-ppo'"),
        ("ppo-stack0", "did you mean 'ppo-stack8'"),
        ("nowhere:Mine", "No module named 'nowhere'"),
        ("tests.training.own:Yours", "no attribute 'Yours'"),
        ("tests.training.own:NoAlgorithm", "no subclass of stable_baselines3's BaseAlgorithm"),
        (":Mine", "expected package.module:object"),
    ],
)
def test_unknown_names(name, message):
    with pytest.raises(UserError, match=message):
        find_algorithm(name)


def test_a_module_or_a_class_that_fails_says_how(tmp_path, monkeypatch):
    (tmp_path / "torn_algorithm.py").write_text("class Mine(\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="importing it failed: SyntaxError"):
        find_algorithm("torn_algorithm:Mine")
    with pytest.raises(UserError, match="KeyError: 'its own reasons'"):
        train_tiny("tests.training.own:Failing", tmp_path / "run", hyperparams=None, steps=100)


def test_stacked_frames_come_from_the_name_or_the_file():
    assert load_hyperparameters("ppo-stack8", ALLY).frame_stack == 8
    assert load_hyperparameters("sac-stack3", ALLY).frame_stack == 3  # on the plain algorithm's values
    assert load_hyperparameters("sac-stack3", ALLY).algorithm == load_hyperparameters("sac", ALLY).algorithm
    given = {"n_envs": 1, "n_timesteps": 1, "frame_stack": 4}
    assert load_hyperparameters("ppo", ALLY, given).frame_stack == 4
    with pytest.raises(UserError, match="frame_stack: ppo-stack8 has 8, got 4"):
        load_hyperparameters("ppo-stack8", ALLY, given)


def test_a_variant_has_values_of_its_own_and_else_those_of_its_class():
    fast = load_hyperparameters("ppo-fast", ALLY).algorithm
    assert fast["policy_kwargs"]["activation_fn"] == "ReLU"
    assert fast != load_hyperparameters("ppo", ALLY).algorithm
    opponent = "FPG/OpponentVsScripted-v0"
    learned = load_hyperparameters("ppo", opponent, path="learned")
    assert load_hyperparameters("ppo-fast", opponent, path="learned") == learned
    assert load_space(find_algorithm("ppo-fast").base) == load_space("ppo")


@pytest.mark.parametrize("sds", [0.3, [0.1] * 6 + [0.5] * 3])
def test_noise_is_as_wide_as_the_file_says_for_all_actions_or_each(sds):
    given = {"n_envs": 1, "n_timesteps": 1, "policy": "MlpPolicy", "noise_type": "normal", "noise_std": sds}
    parameters = load_hyperparameters("td3", ALLY, given)
    model = make_model("td3", make_games(ALLY, parameters, 0), parameters, 0)
    drawn = np.array([model.action_noise() for _ in range(2000)])
    assert drawn.std(axis=0) == pytest.approx(np.broadcast_to(sds, 9), rel=0.1)


@pytest.mark.parametrize("algorithm", ["ppo", "td3", "ppo-stack4"])
def test_an_opponent_that_flies_itself_is_trained_with_values_of_its_own(algorithm):
    own = load_hyperparameters(algorithm, "FPG/OpponentVsScripted-v0", path="learned")
    assert own != load_hyperparameters(algorithm, "FPG/OpponentVsScripted-v0")
    assert (own.imitate is None) == (algorithm == "td3")
    for view, path in (("FPG/OpponentVsScripted-v0", "pursuit"), (ALLY, "learned")):
        assert load_hyperparameters(algorithm, view, path=path) == load_hyperparameters(algorithm, view)
    sac = load_hyperparameters("sac", "FPG/OpponentVsPolicy-v0")
    assert load_hyperparameters("sac", "FPG/OpponentVsPolicy-v0", path="learned") == sac  # has no such file


@pytest.mark.slow
def test_an_algorithm_of_ones_own_is_trained_by_its_name(tmp_path):
    agent = train_tiny("tests.training.own:Mine", tmp_path / "run", hyperparams=None, steps=3200)
    about = load_agent(agent, "ally").about
    assert about["algorithm"] == "tests.training.own:Mine"
    assert about["hyperparameters"] == {"n_envs": 64, "normalize": None, "policy": "MlpPolicy"}
    assert json.loads((tmp_path / "run" / "run.json").read_text())["steps_done"] == 3200


@pytest.mark.slow
def test_or_by_its_class_with_hyperparameters_of_its_own(tmp_path):
    values = {"n_envs": 4, "n_timesteps": 200, "policy": "MlpPolicy", "bonus": 0.5, "normalize": None}
    agent = train(Mine, ALLY, tmp_path / "run", hyperparams=values)
    assert load_agent(agent).about["hyperparameters"]["bonus"] == 0.5


def test_without_a_file_the_steps_must_be_said(tmp_path):
    with pytest.raises(UserError, match=r"steps: .* has no hyper-parameter file"):
        train(Mine, ALLY, tmp_path / "run")


def test_a_policy_that_cannot_be_exported_is_refused_before_training(tmp_path):
    with pytest.raises(UserError, match="Doubling computes more than its networks say"):
        train_tiny("tests.training.own:Odd", tmp_path / "run", hyperparams=None, steps=10**9)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("policy_kwargs", {"net_arc": [3]}, "net_arc"),
        ("noise_sd", "abc", "noise_sd: expected a number"),
        ("normalize", {"norm_obs": True}, "knows neither normalize nor frame_stack"),
        ("frame_stack", 2, "knows neither normalize nor frame_stack"),
    ],
)
def test_what_maddpg_does_not_know_is_said_before_anything_is_written(tmp_path, key, value, message):
    given = {"policy": "JointPolicy", "n_envs": 2, "n_timesteps": 10, key: value}
    with pytest.raises(UserError, match=message):
        train("maddpg", DUEL, tmp_path / "run", hyperparams=given)
    assert not (tmp_path / "run").exists()
