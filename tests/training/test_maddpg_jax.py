"""JAX's learner of MADDPG gives torch's numbers."""

import sys

import numpy as np
import pytest
import torch
from torch import nn

from fpg_bench.envs.sb3 import make_sb3_duel
from fpg_bench.errors import UserError
from fpg_bench.training.maddpg import MADDPG, Transitions
from fpg_bench.training.maddpg_seeds import TorchLearner
from tests.training.tiny import learn_together

pytestmark = pytest.mark.slow

UPDATES = 100
NETWORKS = ("actors", "critics", "actor_targets", "critic_targets")


@pytest.fixture(scope="module")
def jax_learner():
    pytest.importorskip("jax", reason='the extra is missing: pip install "fpg-bench[fast]"')
    from fpg_bench.training.maddpg_jax import JaxLearner

    return JaxLearner


def model_of(seed, **more):
    torch.set_num_threads(1)
    policy = {"net_arch": [16, 8], **more.pop("policy_kwargs", {})}
    words = {"learning_starts": 40, "gradient_steps": 3, "logit_penalty": 0.5, "logit_limit": 0.01, **more}
    games = make_sb3_duel(4, seed=seed, scenario="paper")
    return MADDPG("JointPolicy", games, seed=seed, policy_kwargs=policy, **words)


def weights_of(model, name):
    return np.concatenate(
        [each.detach().numpy().ravel() for each in getattr(model.policy, name).parameters()]
    )


def some_batches(seed, updates=UPDATES):
    """Transitions at random; some of them end a game."""
    rng = np.random.default_rng(seed)
    shape = (updates, 32)
    seen, then = rng.uniform(-1, 1, (2, *shape, 30))
    did, dones, rewards = (
        rng.uniform(-1, 1, (*shape, 18)),
        rng.random((*shape, 1)) < 0.1,
        rng.normal(size=(*shape, 2)),
    )
    return Transitions(*(each.astype(np.float32) for each in (seen, did, then, dones, rewards)))


@pytest.mark.parametrize("activation", [nn.ReLU, nn.Tanh])
def test_a_hundred_updates_give_the_same_weights(jax_learner, activation):
    learned = {}
    for kind in (TorchLearner, jax_learner):
        models = [model_of(seed, policy_kwargs={"activation_fn": activation}) for seed in (0, 1)]
        begun = {name: weights_of(models[0], name) for name in NETWORKS}
        learner = kind(models)
        for part in np.split(np.arange(UPDATES), 4):
            learner.learn([Transitions(*(each[part] for each in some_batches(seed))) for seed in (0, 1)])
        learner.write()
        learned[kind] = models
    for ours, theirs in zip(*learned.values(), strict=True):
        for name in NETWORKS:
            assert np.abs(weights_of(ours, name) - weights_of(theirs, name)).max() < 1e-5
    assert all(np.abs(weights_of(models[0], name) - begun[name]).max() > 0.01 for name in NETWORKS)


def test_training_is_the_same_by_both_learners(jax_learner):
    found = []
    for learner in ("torch", "jax"):
        models = {seed: model_of(seed) for seed in (0, 1)}
        learn_together(models, 120, learner)
        found.append(models)
    for ours, theirs in zip(*(models.values() for models in found), strict=True):
        assert ours.updates == theirs.updates == 60
        assert np.allclose(ours.replay_buffer.actions, theirs.replay_buffer.actions, atol=1e-4)
        assert np.allclose(weights_of(ours, "critics"), weights_of(theirs, "critics"), atol=1e-4)


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ({"optimizer_class": torch.optim.SGD}, "knows Adam"),
        ({"optimizer_kwargs": {"weight_decay": 0.1}}, "weight_decay"),
        ({"activation_fn": nn.Mish}, "Mish"),
    ],
)
def test_what_it_does_not_know_is_said(jax_learner, policy, words):
    with pytest.raises(UserError, match=words):
        jax_learner([model_of(0, policy_kwargs=policy)])


def test_an_extra_that_is_missing_is_said_in_a_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    monkeypatch.delitem(sys.modules, "fpg_bench.training.maddpg_jax", raising=False)
    with pytest.raises(UserError, match=r'pip install "fpg-bench\[fast\]"$'):
        learn_together({0: model_of(0)}, 240, "jax")


def test_another_learner_is_said_in_a_line():
    with pytest.raises(UserError, match="torch or jax, got 'jaxx'; did you mean 'jax'"):
        learn_together({0: model_of(0)}, 240, "jaxx")
