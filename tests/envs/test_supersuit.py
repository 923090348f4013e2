"""The SuperSuit bridge: a working SB3 ``VecEnv`` of agents, with what SuperSuit gets wrong repaired."""

from __future__ import annotations

import numpy as np
import pytest
import supersuit
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from fpg_bench import make_duel, supersuit_vec_env
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.game.batch import check_seeds
from fpg_bench.players.player import SIDES

from .playing import SHORT, STEPS, tape

GAMES = 3


def make(games=GAMES, **options):
    return supersuit_vec_env(games, **{"scenario": SHORT, **options})


def test_a_slot_is_an_agent_and_copy_i_is_game_i_of_the_duel():
    env, duel = make(seed=20), make_duel(GAMES, scenario=SHORT)
    assert isinstance(env, VecEnv)
    observations = env.reset()
    duel.reset(seeds=20)
    actions = tape(2 * GAMES, 2 * STEPS)
    for k, action in enumerate(actions):
        present = duel.present()
        assert np.array_equal(observations[0::2], present.ally_observations)
        assert np.array_equal(observations[1::2], present.opponent_observations)
        observations, rewards, dones, infos = env.step(action)
        step = duel.step(action[0::2], action[1::2])
        assert np.array_equal(rewards[0::2], step.ally_rewards.astype(np.float32))
        assert np.array_equal(rewards[1::2], step.opponent_rewards.astype(np.float32))
        assert dones.all() == dones.any() == ((k + 1) % STEPS == 0)
        if dones.all():
            for slot, info in enumerate(infos):
                assert info["TimeLimit.truncated"] is True
                assert np.array_equal(info["terminal_observation"], step[slot % 2][slot // 2])
                returns = info["measures"][f"{SIDES[slot % 2]}_return"]
                assert info["episode"]["r"] == pytest.approx(returns, rel=1e-4)
                assert info["episode"]["l"] == STEPS
            duel.reset()


def test_seeds_are_for_the_next_reset():
    env = make()
    assert env.seed(5) == np.repeat(check_seeds(5, GAMES), 2).tolist()
    first = env.reset()
    assert len({row.tobytes() for row in first}) == 2 * GAMES
    assert env.get_attr("render_mode") == [None] * 2 * GAMES
    assert np.array_equal(*env.env_method("state", indices=[0, 1]))
    env.set_attr("note", "mine", indices=[2])
    assert env.get_attr("note", indices=3) == ["mine"]
    assert env.env_is_wrapped(VecNormalize) == [False] * 2 * GAMES
    assert not np.array_equal(first, env.reset())
    env.seed(5)
    assert np.array_equal(first, env.reset())


def test_supersuits_frame_skip_draws_by_the_seed():
    env = supersuit.frame_skip_v0(parallel_env(scenario=SHORT), (1, 5))
    lengths = []
    for seed in (4, 4, 5):
        env.reset(seed=seed)
        lengths.append([])
        while env.agents:
            env.step(dict.fromkeys(SIDES, np.zeros(9, np.float32)))
            lengths[-1].append(int(env.unwrapped.duel.batch.games["step"][0]))
    assert lengths[0] == lengths[1] != lengths[2]


@pytest.mark.slow
def test_one_policy_learns_both_sides_and_time_limits_are_bootstrapped_through():
    options = {"policy_kwargs": {"net_arch": [16]}, "device": "cpu", "seed": 0}
    model = SAC("MlpPolicy", VecNormalize(make(1)), learning_starts=1000, buffer_size=200, **options)
    model.learn(2 * 2 * (STEPS + 5))
    assert len(model.ep_info_buffer) == 2 * 2
    ends = model.replay_buffer.dones.astype(bool)
    assert ends.sum() == 2 * 2
    assert np.array_equal(model.replay_buffer.timeouts.astype(bool), ends)
