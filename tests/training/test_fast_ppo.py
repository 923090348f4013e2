"""FastPPO learns what PPO learns from the same random numbers, and leaves to it what it does not serve."""

import logging
from functools import partial

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.utils import set_random_seed
from torch import nn

from fpg_bench import FastPPO, make_sb3
from tests.training.tiny import ALLY

games = partial(make_sb3, ALLY, 16, seed=0, stagger=True)
ARRAYS = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs", "returns")
SIZES = {"n_steps": 64, "batch_size": 256, "n_epochs": 2}


class Rollout(BaseCallback):
    """Keeps the arrays of the last rollout, and the number of steps."""

    def __init__(self):
        super().__init__()
        self.arrays, self.steps = {}, 0

    def _on_step(self):
        self.steps += 1
        return True

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        self.arrays = {name: getattr(buffer, name).copy() for name in ARRAYS}


def learned(kind, make, options, steps=1):
    """A model after some rollouts and updates, from given random numbers."""
    set_random_seed(3)
    model = kind("MlpPolicy", make(), device="cpu", **SIZES | options)
    rollout = Rollout()
    model.learn(steps * model.n_steps * model.n_envs, rollout)
    return model, rollout


CASES = {
    "relu": (games, {"policy_kwargs": {"activation_fn": nn.ReLU, "log_std_init": -0.5}}),
    "tanh and all terms": (games, {"clip_range_vf": 0.2, "ent_coef": 0.05, "batch_size": 200}),
    "choices": (partial(games, actions="discrete"), {"ent_coef": 0.05}),
    "lists of choices": (partial(games, actions="multi-discrete"), {"ent_coef": 0.05}),
    "early stop": (games, {"target_kl": 1e-4, "learning_rate": 0.01, "n_epochs": 5}),
    "no clip": (games, {"max_grad_norm": 1e9, "normalize_advantage": False}),
    "CartPole": (partial(make_vec_env, "CartPole-v1", 4, seed=1), {}),
    "FrozenLake": (partial(make_vec_env, "FrozenLake-v1", 4, seed=1), {}),
    "Pendulum": (
        partial(make_vec_env, "Pendulum-v1", 4, seed=1),
        {"n_steps": 256, "policy_kwargs": {"net_arch": {"pi": [32], "vf": []}}},
    ),
}


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize(("make", "options"), CASES.values(), ids=CASES)
def test_a_rollout_and_its_updates_are_those_of_ppo(make, options, caplog):
    (theirs, expected), (ours, rollout) = (learned(kind, make, options) for kind in (PPO, FastPPO))
    assert not caplog.records
    assert rollout.steps == expected.steps
    for name in ARRAYS:
        np.testing.assert_allclose(rollout.arrays[name], expected.arrays[name], rtol=1e-5, atol=1e-5)
    before = learned(PPO, make, options | {"learning_rate": 0.0})[0].policy.parameters()
    for start, one, other in zip(before, theirs.policy.parameters(), ours.policy.parameters(), strict=True):
        assert not torch.equal(start, one)
        torch.testing.assert_close(one, other, rtol=0, atol=1e-5)
    assert ours._n_updates == theirs._n_updates
    logs = (theirs.logger.name_to_value, ours.logger.name_to_value)
    assert logs[0].keys() == logs[1].keys()
    for name in (name for name in logs[0] if name.startswith("train/")):
        assert logs[1][name] == pytest.approx(logs[0][name], rel=1e-4, abs=1e-5), name


@pytest.mark.parametrize(
    ("make", "options", "reason"),
    [
        (games, {"policy_kwargs": {"activation_fn": nn.GELU}}, "the activation is GELU"),
        (games, {"use_sde": True}, "use_sde is set"),
        (partial(make_vec_env, "CartPole-v1", 4, seed=1), {"policy": "CnnPolicy"}, "CnnPolicy"),
    ],
)
def test_what_it_does_not_serve_is_trained_by_ppo(make, options, reason, caplog, monkeypatch):
    if "policy" in options:  # a policy of another class
        monkeypatch.setitem(
            PPO.policy_aliases, "MlpPolicy", type("CnnPolicy", (PPO.policy_aliases["MlpPolicy"],), {})
        )
        options = {}
    (theirs, _), (ours, _) = (learned(kind, make, options) for kind in (PPO, FastPPO))
    (record,) = caplog.records
    assert (record.levelno, reason in record.message) == (logging.WARNING, True)
    for one, other in zip(theirs.policy.parameters(), ours.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_frozen_weights_stay():
    model = FastPPO("MlpPolicy", games(), device="cpu", **SIZES)
    frozen = model.policy.mlp_extractor.policy_net[0].weight.requires_grad_(False)
    before = frozen.clone()
    model.learn(1024)
    assert torch.equal(frozen, before)


def test_a_saved_model_is_one_of_ppo_and_goes_on_as_it_would(tmp_path):
    model, _ = learned(FastPPO, games, {})
    model.save(tmp_path / "model.zip")
    others = [kind.load(tmp_path / "model.zip", env=games(), device="cpu") for kind in (PPO, FastPPO)]
    for other in others:
        set_random_seed(4)
        other.learn(1024, reset_num_timesteps=False)
        assert other.num_timesteps == 2048
    for one, other in zip(*(each.policy.parameters() for each in others), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-5)


def test_callbacks_may_learn_and_stop_it():
    class Learner(BaseCallback):
        def _on_rollout_start(self):
            assert torch.is_grad_enabled()  # as a rival that learns here needs it

        def _on_step(self):
            return self.num_timesteps < 160

    assert FastPPO("MlpPolicy", games(), device="cpu", **SIZES).learn(1024, Learner()).num_timesteps == 160
