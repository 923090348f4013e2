"""Hyper-parameters as rl-zoo3 writes them are read, without evaluating anything."""

from __future__ import annotations

import importlib.util
from collections import OrderedDict
from pathlib import Path

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.training.hyperparameters import load_hyperparameters
from tests.training.tiny import ALLY, settings, train_tiny

THEIRS = """
FPG/AllyVsScripted-v0:
  normalize: true
  n_envs: !!float 4
  n_timesteps: !!float 1e6
  policy: 'MlpPolicy'
  n_steps: !!float 512
  learning_rate: !!float 3e-5
  clip_range: lin_0.4
  policy_kwargs: "dict(log_std_init=-2,
                       ortho_init=False,
                       activation_fn=nn.ReLU,
                       net_arch=[dict(pi=[256, 256], vf=[256, 256])]
                       )"
"""
PLAIN = {
    "normalize": {},
    "n_envs": 4,
    "n_timesteps": 1_000_000,
    "policy": "MlpPolicy",
    "n_steps": 512,
    "learning_rate": 3e-5,
    "clip_range": "lin_0.4",
    "policy_kwargs": {
        "log_std_init": -2,
        "ortho_init": False,
        "activation_fn": "ReLU",
        "net_arch": [{"pi": [256, 256], "vf": [256, 256]}],
    },
}


def load(text, tmp_path, algorithm="ppo"):
    file = tmp_path / "theirs.yml"
    file.write_text(text if isinstance(text, str) else yaml.safe_dump({ALLY: text}))
    return load_hyperparameters(algorithm, ALLY, file)


def test_an_entry_of_rl_zoo3_is_the_plain_one(tmp_path):
    read = load(THEIRS, tmp_path).entry()
    assert read == PLAIN
    assert [type(read[key]) for key in ("n_envs", "n_timesteps", "n_steps")] == [int] * 3


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        (False, None),
        (True, {}),
        ("{'norm_obs': True, 'norm_reward': False}", {"norm_obs": True, "norm_reward": False}),
        ("dict(norm_obs=False, clip_obs=5.0)", {"norm_obs": False, "clip_obs": 5.0}),
    ],
)
def test_normalize_is_a_bool_or_a_mapping_in_a_text(written, meant, tmp_path):
    assert load({"policy": "MlpPolicy", "normalize": written}, tmp_path).normalize == meant


def test_the_configuration_of_a_run_of_rl_zoo3_is_read(tmp_path):
    saved = OrderedDict(sorted({**PLAIN, "normalize": True, "clip_range": 0.2}.items()))
    text = yaml.dump(saved)
    assert "collections.OrderedDict" in text
    assert load(text, tmp_path).entry() == {**PLAIN, "clip_range": 0.2}
    off_policy = yaml.dump(OrderedDict(policy="MlpPolicy", train_freq=(1, "episode")))
    assert load(off_policy, tmp_path, "sac").algorithm["train_freq"] == [1, "episode"]
    twice = "!!python/object/apply:collections.OrderedDict [[[policy, A], [policy, B]]]"
    with pytest.raises(UserError, match="a key stands there twice"):
        load(twice, tmp_path)


@pytest.mark.parametrize(
    "tag", ["object/apply:os.system", "name:os.system", "object/new:os.system", "module:os"]
)
def test_no_other_object_of_python_is_made(tag, tmp_path):
    with pytest.raises(UserError, match="not valid YAML"):
        load(f"{ALLY}: {{policy: !!python/{tag} [touch made]}}", tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "dict(net_arch=__import__('os').system('touch evaluated'))",
        "dict(**{'net_arch': [64]})",
        "dict([('net_arch', [64])])",
        "{'net_arch': [64 * 10 ** 10]}",
        "{[1]: 2}",
        "dict(optimizer_class=RMSpropTFLike)",
        "dict(",
        "(" * 5000,
        "-" * 9000 + "1",
        "[" * 60 + "]" * 60,
        "x" * 20_000,
    ],
)
def test_what_is_no_literal_is_neither_evaluated_nor_read(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="policy_kwargs: ") as raised:
        train_tiny("ppo", tmp_path / "run", {"policy_kwargs": text})
    assert len(str(raised.value)) < 400
    assert not list(tmp_path.iterdir())


def test_all_that_cannot_be_read_is_named_at_once(tmp_path):
    entry = {
        "policy": "MlpPolicy",
        "n_envs": 2.5,
        "n_step": 64,
        "env_wrapper": "rl_zoo3.wrappers.FrameSkip",
        "gamma": 1.5,
        "policy_kwargs": "dict(optimizer_class=Adam)",
        "normalize": {"norm_obz": True, "clip_obs": -1},
    }
    with pytest.raises(UserError) as raised:
        load(entry, tmp_path)
    parts = (
        "policy_kwargs: 'Adam' is no literal",
        "n_envs: expected a whole number above 0, at most 100,000, got 2.5",
        "unknown key 'n_step'; did you mean 'n_steps'?",
        "unknown key 'env_wrapper'",
        "gamma: expected a number from 0 to 1, got 1.5",
        "normalize: unknown key 'norm_obz'; did you mean 'norm_obs'?",
        "normalize: clip_obs: expected a number above 0, got -1",
    )
    assert [part for part in parts if part not in str(raised.value)] == []


@pytest.mark.slow
def test_sizes_in_a_text_and_a_budget_from_the_call_train(tmp_path):
    entry = settings("ppo", policy_kwargs={"net_arch": "[8.0, 8]"})
    del entry["n_timesteps"]
    with pytest.raises(UserError, match="give the steps"):
        train_tiny("ppo", tmp_path / "none", hyperparams=entry)
    agent = train_tiny("ppo", tmp_path / "run", hyperparams=entry, steps=1200)
    assert (agent / "policy.onnx").is_file()


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl-zoo3 is not installed")
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "dqn"])
def test_all_of_rl_zoo3_s_own_entries_are_read_but_for_those_with_wrappers_or_goals(algorithm):
    file = Path(importlib.util.find_spec("rl_zoo3").origin).parent / "hyperparams" / f"{algorithm}.yml"
    entries = yaml.safe_load(file.read_text())
    assert len(entries) > 5
    for env_id, entry in entries.items():
        if "env_wrapper" in entry:
            with pytest.raises(UserError, match="unknown key 'env_wrapper'"):
                load_hyperparameters(algorithm, env_id, file)
        elif entry.get("replay_buffer_class") == "HerReplayBuffer":
            with pytest.raises(UserError, match="needs goals, which the game lacks"):
                load_hyperparameters(algorithm, env_id, file)
        else:
            assert load_hyperparameters(algorithm, env_id, file).n_timesteps > 0


def test_a_default_entry_is_that_of_ids_without_one(tmp_path):
    file = tmp_path / "ppo.yml"
    other = "FPG/OpponentVsScripted-v0"
    file.write_text(f"default: {{policy: MlpPolicy, n_steps: 32}}\n{other}: {{policy: MlpPolicy}}")
    assert load_hyperparameters("ppo", ALLY, file).algorithm["n_steps"] == 32
    assert "n_steps" not in load_hyperparameters("ppo", other, file).algorithm
