"""MADDPG learns the same by torch and by JAX."""

import sys

import numpy as np
import pytest
import torch
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.products.maddpg import MADDPG
from fpg_bench.products.maddpg.maddpg import JointTransitions
from fpg_bench.products.papers.yang_2026.experiment import check_learner

STEPS, UPDATES = 240, 100
NETWORKS = ("actors", "critics", "actor_targets", "critic_targets")


def make_model(seed, **policy):
    torch.set_num_threads(1)
    rates = {"learning_starts": 40, "train_freq": 2, "gradient_steps": 3}
    penalty = {"logit_penalty": 0.5, "logit_limit": 0.01}
    games = make_sb3("FPG/duel_v0", 4, seed=seed, scenario="paper")
    kwargs = {"net_arch": [16, 8], **policy}
    return MADDPG("JointPolicy", games, seed=seed, policy_kwargs=kwargs, **rates, **penalty)


def weights_of(model, name):
    return np.concatenate(
        [each.detach().numpy().ravel() for each in getattr(model.policy, name).parameters()]
    )


@pytest.fixture(scope="module")
def jax_learner():
    pytest.importorskip("jax", reason='the extra is missing: pip install "fpg-bench[fast]"')
    from fpg_bench.products.maddpg.jax_learner import JaxLearner

    return JaxLearner


def random_batches(seed):
    """Random transitions, some of which end a game."""
    rng = np.random.default_rng(seed)
    shape = (UPDATES, 32)
    obs, next_obs = rng.uniform(-1, 1, (2, *shape, 30))
    actions, dones = rng.uniform(-1, 1, (*shape, 18)), rng.random((*shape, 1)) < 0.1
    arrays = (obs, actions, next_obs, dones, rng.normal(size=(*shape, 2)))
    return JointTransitions(*(each.astype(np.float32) for each in arrays))


@pytest.mark.full
@pytest.mark.slow
def test_a_hundred_updates_by_jax_give_torch_s_weights(jax_learner):
    expected, model = (make_model(0, activation_fn=nn.Tanh) for _ in range(2))
    start = {name: weights_of(expected, name) for name in NETWORKS}
    batches = random_batches(0)
    expected.update(batches)
    learner = jax_learner(model)
    for part in np.split(np.arange(UPDATES), 4):
        learner.update(JointTransitions(*(each[part] for each in batches)))
    learner.write()
    for name in NETWORKS:
        assert np.abs(weights_of(model, name) - weights_of(expected, name)).max() < 1e-5
        assert np.abs(weights_of(expected, name) - start[name]).max() > 0.01


@pytest.mark.full
@pytest.mark.slow
def test_training_is_the_same_by_both_learners(jax_learner):
    for seed in (0, 1):
        expected = make_model(seed)
        expected.learn(STEPS)
        model = make_model(seed)
        jax_learner(model).learn(STEPS)
        assert model.num_timesteps == expected.num_timesteps == STEPS
        assert model.n_updates == expected.n_updates == 3 * (STEPS - 40) // 8
        assert np.allclose(model.replay_buffer.actions, expected.replay_buffer.actions, atol=1e-4)
        assert np.allclose(weights_of(model, "critics"), weights_of(expected, "critics"), atol=1e-4)


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        ({"optimizer_class": torch.optim.SGD}, "supports Adam"),
        ({"optimizer_kwargs": {"weight_decay": 0.1}}, "weight_decay"),
        ({"activation_fn": nn.Mish}, "Mish"),
    ],
)
def test_jax_refuses_what_it_does_not_support(jax_learner, policy, message):
    with pytest.raises(UserError, match=message):
        jax_learner(make_model(0, **policy))


def test_a_missing_extra_or_an_unknown_learner_is_one_line(monkeypatch):
    with pytest.raises(UserError, match="torch or jax, got 'jaxx'; did you mean 'jax'"):
        check_learner("jaxx")
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(UserError, match=r"is not installed: pip install .*\[fast\]"):
        check_learner("jax")
