"""MADDPG on a game with a known equilibrium, and as a model of SB3's kind."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.products.maddpg import MADDPG

# Player i gets -a_i^2 + LIKES_i a_i + PULLS_i a_0 a_1: the symmetric part of the game's Jacobian is -2 on the
# diagonal and 0 elsewhere, so it is strongly monotone and has one equilibrium, whatever is done on the way.
LIKES, PULLS = np.array([0.5, 0.7]), np.array([1.0, -1.0])
POLICY = {"net_arch": [32], "optimizer_kwargs": {"fused": True}}  # fused as shipped
QUICK = {"learning_rate": 0.005, "learning_starts": 100, "policy_kwargs": POLICY}
EQUILIBRIUM = np.linalg.solve([[2, -PULLS[0]], [-PULLS[1], 2]], LIKES)


class QuadraticGame(VecEnv):
    """One step long, nothing to see but zeros; the first player also has an action that does nothing."""

    sizes = ((3, 2), (1, 1))

    def __init__(self, games):
        super().__init__(games, spaces.Box(-1, 1, (4,)), spaces.Box(-1, 1, (3,)))

    def reset(self):
        return np.zeros((self.num_envs, 4), np.float32)

    def step_async(self, actions):
        self.acts = np.stack([actions[:, 0], actions[:, 2]], 1)

    def step_wait(self):
        rewards = -(self.acts**2) + LIKES * self.acts + PULLS * self.acts.prod(axis=1, keepdims=True)
        infos = [{"terminal_observation": np.zeros(4, np.float32)}] * self.num_envs
        return self.reset(), rewards, np.ones(self.num_envs, bool), infos

    def get_attr(self, name, indices=None):
        return [getattr(self, name)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *arguments, indices=None, **more):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper, indices=None):
        return [False] * self.num_envs

    def close(self):
        pass


@pytest.fixture(scope="module")
def model():
    torch.set_num_threads(1)
    settings = QUICK | {"batch_size": 64, "noise_sd": 0.3, "tau": 0.05}
    return MADDPG("JointPolicy", QuadraticGame(4), seed=2, **settings).learn(1200)


@pytest.mark.full
@pytest.mark.slow
def test_maddpg_finds_the_equilibrium_of_a_strongly_monotone_game(model):
    acts = model.predict(np.zeros(4, np.float32))[0][[0, 2]]
    assert acts == pytest.approx(EQUILIBRIUM, abs=0.07)


@pytest.mark.full
@pytest.mark.slow
def test_a_penalty_keeps_actions_near_its_limit():
    """The equilibrium's actions are 0.34 and 0.18: 0.35 and 0.18 before tanh."""
    for limit, steps, least, most in ((0.0, 400, 0.0, 0.3), (1.0, 800, 0.6, 1.5)):
        penalty = {"logit_penalty": 10, "logit_limit": limit}
        model = MADDPG("JointPolicy", QuadraticGame(4), seed=0, **QUICK, **penalty)
        action = model.learn(steps).predict(np.zeros(4, np.float32))[0][0]
        assert least * EQUILIBRIUM[0] <= action <= most * EQUILIBRIUM[0]


@pytest.mark.slow
def test_critics_see_all_actions_and_learn_their_own_reward(model):
    seen, acts = torch.zeros(2, 4), torch.tensor([[0.5, 0.0, 0.5], [-0.5, 0.0, 0.5]])
    with torch.no_grad():
        found = torch.cat([critic(seen, acts)[0] for critic in model.policy.critics], 1).numpy()
    both = acts[:, [0, 2]].numpy()
    rewards = -(both**2) + LIKES * both + PULLS * both.prod(axis=1, keepdims=True)
    assert found == pytest.approx(rewards, abs=0.15)


@pytest.mark.slow
def test_an_actor_sees_only_its_own_observation(model):
    rng = np.random.default_rng(0)
    seen = rng.uniform(-1, 1, (5, 4)).astype(np.float32)
    other = seen.copy()
    other[:, 3] = -other[:, 3]
    ours, theirs = (model.predict(observation)[0] for observation in (seen, other))
    assert np.array_equal(ours[:, :2], theirs[:, :2])
    assert not np.allclose(ours[:, 2], theirs[:, 2])


@pytest.mark.slow
def test_a_loaded_model_continues_to_learn(model, tmp_path):
    model.save(tmp_path / "model.zip")
    model.save_replay_buffer(tmp_path / "buffer.pkl")
    again = MADDPG.load(tmp_path / "model.zip", env=QuadraticGame(4))
    again.load_replay_buffer(tmp_path / "buffer.pkl")
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 4)).astype(np.float32)
    assert np.array_equal(model.predict(seen)[0], again.predict(seen)[0])
    moments = [
        [state["exp_avg"] for state in found.policy.critic_optimizer.state.values()]
        for found in (model, again)
    ]
    assert all(map(torch.equal, *moments))
    updates = again._n_updates
    again.learn(400, reset_num_timesteps=False)
    assert again._n_updates == updates + 100
    assert again.replay_buffer.rewards.shape[1:] == (4, 2)


@pytest.mark.slow
def test_maddpg_plays_both_sides_of_the_game():
    games = make_sb3("FPG/duel_v0", 4, seed=0)
    model = MADDPG("JointPolicy", games, learning_starts=1000, policy_kwargs={"net_arch": [16]}).learn(1240)
    assert model._n_updates == 60
    assert [info["l"] for info in model.ep_info_buffer] == [300] * 4
    assert model.predict(games.reset())[0].shape == (4, 18)


@pytest.mark.slow
def test_the_same_seed_learns_the_same():
    found = [
        MADDPG("JointPolicy", QuadraticGame(2), seed=seed, learning_starts=20)
        .learn(100)
        .predict(np.ones(4))[0]
        for seed in (3, 3, 4)
    ]
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])
