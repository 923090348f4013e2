"""Several seeds of MADDPG at once learn what each of them learns alone."""

import numpy as np
import pytest
import torch

from fpg_bench.envs.sb3 import make_sb3_duel
from fpg_bench.training.maddpg import MADDPG
from tests.training.tiny import learn_together

STEPS = 480


def model_of(seed, limit=0.0):
    torch.set_num_threads(1)
    games = make_sb3_duel(4, seed=seed, scenario="paper")
    network = {"net_arch": [16, 8], "optimizer_kwargs": {"fused": True}}
    return MADDPG(
        "JointPolicy",
        games,
        seed=seed,
        learning_starts=40,
        train_freq=2,
        gradient_steps=3,
        logit_penalty=0.5,
        logit_limit=limit,
        policy_kwargs=network,
    )


def weights_of(model):
    return np.concatenate([each.detach().numpy().ravel() for each in model.policy.parameters()])


@pytest.fixture(scope="module")
def together():
    models = {seed: model_of(seed) for seed in (0, 1, 2)}
    learn_together(models, STEPS)
    return models


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_each_learns_what_it_learns_alone(together, seed):
    alone, found = model_of(seed), together[seed]
    begun = weights_of(alone)
    alone.learn(STEPS)
    assert found.num_timesteps == alone.num_timesteps == STEPS
    assert found._n_updates == alone._n_updates == 3 * (STEPS - 40) // 8
    moved = np.abs(weights_of(alone) - begun).max()
    assert np.abs(weights_of(found) - weights_of(alone)).max() < 1e-3 * moved
    assert np.allclose(found.replay_buffer.actions, alone.replay_buffer.actions, atol=1e-4)


def test_they_do_not_learn_the_same(together):
    assert np.abs(weights_of(together[0]) - weights_of(together[1])).max() > 0.01


def test_whom_a_seed_learns_with_makes_no_difference(together):
    models = {seed: model_of(seed) for seed in (2, 5)}
    learn_together(models, STEPS)
    assert np.allclose(weights_of(models[2]), weights_of(together[2]), atol=1e-5)


@pytest.mark.slow
def test_the_penalty_s_limit_counts_as_it_does_alone():
    alone, found = (model_of(0, limit=0.01) for _ in range(2))
    begun = weights_of(alone)
    alone.learn(STEPS)
    learn_together({0: found}, STEPS)
    moved = np.abs(weights_of(alone) - begun).max()
    assert np.abs(weights_of(found) - weights_of(alone)).max() < 1e-3 * moved
