"""Algorithms by name or class, their hyper-parameters, and the models made from them."""

import json

import numpy as np
import pytest
import torch
import yaml
from sb3_contrib import TQC, MaskablePPO, RecurrentPPO
from stable_baselines3 import PPO, TD3
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ENVS
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.training.algorithms import ALGORITHMS, JOINT, OFFLINE, find_algorithm
from fpg_bench.training.export import check_exportable
from fpg_bench.training.fast_ppo import FastPPO
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import as_activation, make_model
from tests.environments import ROOT
from tests.training.own import Mine
from tests.training.tiny import ALLY, SMALL, settings, train, train_tiny

OPPONENT = "FPG/OpponentVsScripted-v0"


def model_of(algorithm, values):
    parameters = load_hyperparameters(algorithm, ALLY, values)
    return make_model(algorithm, make_sb3(ALLY, parameters.n_envs, 0), parameters, 0)


# Algorithms


def test_an_algorithm_is_found_by_its_name_or_class():
    for name, kind, frames, memory in (
        ("ppo-fast-memory", FastPPO, None, True),
        ("td3-stack4", TD3, 4, False),
        ("ppo-fast-stack8", FastPPO, 8, False),
        ("maskable-ppo-stack2-memory", MaskablePPO, 2, True),
        ("recurrent-ppo", RecurrentPPO, None, False),
        ("sb3_contrib:TQC", TQC, None, False),
        (PPO, PPO, None, False),
    ):
        algorithm = find_algorithm(name)
        assert (algorithm.kind, algorithm.frame_stack, algorithm.memory) == (kind, frames, memory)


def test_every_algorithm_is_found_and_in_the_guide():
    guide = (ROOT / "docs/guides/training.md").read_text()
    for name in (*ALGORITHMS, *JOINT, *OFFLINE):
        algorithm = find_algorithm(name)
        assert (algorithm.joint, algorithm.offline) == (name in JOINT, name in OFFLINE)
        assert f"`{name}`" in guide
    for name in ("recurrent-ppo-stack2", "maddpg-stack2", "maddpg-memory", "iql-memory"):
        with pytest.raises(UserError, match="unknown algorithm"):
            find_algorithm(name)


def test_unknown_algorithms_are_refused(tmp_path, monkeypatch):
    (tmp_path / "torn_algorithm.py").write_text("class Mine(\n")
    monkeypatch.chdir(tmp_path)
    for name, message in (
        ("recurrent_ppo", "did you mean 'recurrent-ppo'"),
        ("", "unknown algorithm ''"),
        ("ppo-stack0", "did you mean 'ppo-stack8'"),
        ("nowhere:Mine", "No module named 'nowhere'"),
        ("tests.training.own:Yours", "no attribute 'Yours'"),
        ("tests.training.own:NoAlgorithm", "not a subclass of stable_baselines3's BaseAlgorithm"),
        (":Mine", "expected package.module:object"),
        ("torn_algorithm:Mine", "importing it failed: SyntaxError"),
    ):
        with pytest.raises(UserError, match=message):
            find_algorithm(name)


@pytest.mark.slow
def test_a_user_s_own_algorithm_is_trained_by_its_name_or_class(tmp_path):
    agent = train_tiny("tests.training.own:Mine", tmp_path / "name", hyperparams=None, steps=3200)
    about = load_agent(agent, "ally").card.to_dict()
    assert about["algorithm"] == "tests.training.own:Mine"
    assert about["hyperparameters"] == {"n_envs": 64, "normalize": None, "policy": "MlpPolicy"}
    values = {"n_envs": 4, "n_timesteps": 200, "policy": "MlpPolicy", "bonus": 0.5, "normalize": None}
    agent = train(Mine, ALLY, tmp_path / "class", hyperparams=values)
    assert load_agent(agent).card.hyperparameters["bonus"] == 0.5


def test_a_user_s_own_algorithm_that_cannot_be_trained_is_refused(tmp_path):
    for algorithm, steps, message in (
        (Mine, None, r"steps: .* has no hyper-parameter file"),
        ("tests.training.own:Failing", 100, "KeyError: 'its own reasons'"),
        ("tests.training.own:Odd", 10**9, "Doubling computes more than its networks do"),
    ):
        with pytest.raises(UserError, match=message):
            train(algorithm, ALLY, tmp_path / "run", steps=steps)
    assert not (tmp_path / "run").exists()


# Hyper-parameters


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_shipped_hyperparameters_make_a_model_for_every_id(algorithm, monkeypatch):
    monkeypatch.setenv("FPG_LLM_BASE_URL", "http://127.0.0.1:9/v1")  # never asked
    monkeypatch.setenv("FPG_LLM_MODEL", "none")
    is_discrete = algorithm in ("dqn", "qr-dqn", "maskable-ppo", "dueling-ddqn")
    actions = "discrete" if is_discrete else "continuous"
    for env_id in ENVS:
        game = GameSpec(env_id, actions=actions)
        make_model(algorithm, make_sb3(game, n_envs=2), load_hyperparameters(algorithm, game), seed=0)


def test_shipped_files_hold_nothing_to_evaluate():
    """rl-zoo3 evaluates text values."""
    known = {"MlpPolicy", "JointPolicy", "MlpLstmPolicy", "normal", "auto_0.1"}
    known |= {"lin_0.005", "lin_0.003", "lin_0.001", "lin_0.002", "lin_0.0007", "lin_0.0005"}
    for path in (baselines_folder() / "hyperparams").glob("*.yml"):
        values = [value for entry in yaml.safe_load(path.read_text()).values() for value in entry.values()]
        assert {value for value in values if isinstance(value, str)} <= known, path


def test_stacked_frames_come_from_the_name_or_the_file():
    assert load_hyperparameters("ppo-stack8", ALLY).frame_stack == 8
    assert load_hyperparameters("sac-stack3", ALLY).frame_stack == 3  # with the plain algorithm's values
    assert load_hyperparameters("sac-stack3", ALLY).algorithm == load_hyperparameters("sac", ALLY).algorithm
    given = {"n_envs": 1, "n_timesteps": 1, "frame_stack": 4}
    assert load_hyperparameters("ppo", ALLY, given).frame_stack == 4
    with pytest.raises(UserError, match="frame_stack: ppo-stack8 stacks 8, got 4"):
        load_hyperparameters("ppo-stack8", ALLY, given)


def test_memory_comes_from_the_name_or_the_file():
    assert load_hyperparameters("ppo-stack8-memory", ALLY).memory
    assert load_hyperparameters("ppo-stack8-memory", ALLY).frame_stack == 8
    given = {"n_envs": 4, "policy": "MlpPolicy", "memory": True}
    assert load_hyperparameters("sac", ALLY, given).entry() == given
    for name, shape in (("ppo", (21,)), ("ppo-stack2", (36,))):
        model = model_of(name, given | {"n_steps": 8, "batch_size": 32})
        assert model.observation_space.shape == shape
    assert not load_hyperparameters("ppo", ALLY).memory
    joint = {"policy": "JointPolicy", "memory": True}
    parameters = load_hyperparameters("maddpg", "FPG/duel_v0", joint)
    with pytest.raises(UserError, match="maddpg does not support memory"):
        make_model("maddpg", make_sb3("FPG/duel_v0", 2), parameters, 0)


@pytest.mark.parametrize("algorithm", ["ppo", "td3", "ppo-stack4"])
def test_an_opponent_that_flies_itself_has_values_of_its_own(algorithm):
    own = load_hyperparameters(algorithm, GameSpec(OPPONENT, path="learned"))
    assert own != load_hyperparameters(algorithm, OPPONENT)
    assert (own.imitate is None) == (algorithm == "td3")
    for env_id, path in ((OPPONENT, "pursuit"), (ALLY, "learned")):
        game = GameSpec(env_id, path=path)
        assert load_hyperparameters(algorithm, game) == load_hyperparameters(algorithm, env_id)


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("sds", [0.3, [0.1] * 6 + [0.5] * 3])
def test_noise_is_given_for_all_actions_or_for_each(sds):
    values = {"n_envs": 1, "n_timesteps": 1, "policy": "MlpPolicy"}
    model = model_of("td3", values | {"noise_type": "normal", "noise_std": sds})
    drawn = np.array([model.action_noise() for _ in range(2000)])
    assert drawn.std(axis=0) == pytest.approx(np.broadcast_to(sds, 9), rel=0.1)
    log_stds = [-1.2] * 4 + [-3.5, -0.7] + [-2.0] * 3
    model = model_of("ppo", values | {"policy_kwargs": {"log_std_init": log_stds}})
    assert model.policy.log_std.tolist() == pytest.approx(log_stds)


def test_invalid_hyperparameters_are_refused_before_anything_is_written(tmp_path):
    for changes, message in (
        ({"policy_kwargs": {"log_std_init": [-1.0, 0.3]}}, "expected a number, or 9 of them"),
        ({"policy_kwargs": {"optimizer_kwargs": {"epz": 1}}}, "optimizer_kwargs: unknown key 'epz'"),
        ({"learning_rate": "line_3"}, "or lin_<number>, got 'line_3'"),
        ({"learning_rate": "1e-3"}, "1.0e-4, not 1e-4"),
        ({"noise_std": 0.1}, "noise_type"),
        ({"noise_type": "normal", "noise_std": [1, 2]}, "noise_std: expected a number"),
    ):
        with pytest.raises(UserError, match=message):
            train_tiny("ppo", tmp_path / "run", changes)
    assert not (tmp_path / "run").exists()


def test_keys_that_are_no_text_are_named_all_at_once():
    with pytest.raises(UserError, match=r"unknown key 'None'.*; unknown key '0.5'.*; unknown key 7"):
        load_hyperparameters("ppo", ALLY, settings("ppo") | {None: 5, 0.5: 5, 7: 5})


def test_shipped_hyperparameters_have_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fast = load_hyperparameters("ppo-fast", ALLY)
    assert load_hyperparameters("ppo", ALLY, "ppo-fast") == fast
    with pytest.raises(UserError, match="nor a shipped name; did you mean 'ppo-fast'"):
        load_hyperparameters("ppo", ALLY, "ppo-fats")
    (tmp_path / "ppo-fast").write_text(yaml.safe_dump({ALLY: settings("ppo")}))
    assert load_hyperparameters("ppo", ALLY, "ppo-fast").n_envs == 4  # a file comes first
    with pytest.raises(UserError, match=f"no entry for '{OPPONENT}'"):
        load_hyperparameters("ppo", OPPONENT, "ppo-fast")


# Activations


@pytest.mark.slow
def test_the_activation_of_the_hyperparameters_is_trained_and_exported(tmp_path):
    policy = SMALL | {"activation_fn": "ELU"}
    agent = train_tiny("td3", tmp_path / "run", {"policy_kwargs": policy})
    for file in (tmp_path / "run" / "run.json", agent / "agent.json"):
        assert json.loads(file.read_text())["hyperparameters"]["policy_kwargs"] == policy
    assert load_agent(agent).card.largest_difference < 1e-5
    assert b"Elu" in (agent / "policy.onnx").read_bytes()


def test_an_unknown_activation_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for value, message in (
        ("Rellu", "unknown activation 'Rellu'; did you mean 'ReLU'"),
        ("relu", "did you mean 'ReLU'"),
        ("torch.nn.Rellu", "unknown activation 'Rellu'; did you mean 'ReLU'"),
        ("__import__('os').system('touch evaluated')", "unknown activation .*; known: CELU, ELU"),
        (3, "expected the name of an activation such as ReLU, got 3"),
        (str, "expected the name of an activation"),
    ):
        changes = {"policy_kwargs": SMALL | {"activation_fn": value}}
        with pytest.raises(UserError, match=f"of ppo: activation_fn: .*({message})"):
            train_tiny("ppo", tmp_path / "run", changes)
    assert not list(tmp_path.iterdir())
    assert as_activation(nn.GELU, "here") is nn.GELU  # a class, from Python
    assert as_activation("nn.GELU", "here") is nn.GELU  # as rl-zoo3 writes it


def test_the_trial_export_keeps_torch_s_random_state():
    model = PPO("MlpPolicy", make_sb3(ALLY, n_envs=2, seed=0), n_steps=4, batch_size=8)
    before = torch.get_rng_state()
    check_exportable(model)
    assert torch.equal(torch.get_rng_state(), before)
