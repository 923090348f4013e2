"""The SB3 environment: same-step autoreset, truncations, and what SB3 asks of a ``VecEnv``."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecCheckNan, VecFrameStack, VecNormalize, VecVideoRecorder

from fpg_bench import make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.game.batch import check_seeds

from .playing import ALLY, ALLY_POLICY, OPPONENT_POLICY, SHORT, STEPS, tape

GAMES = 3
REST = np.zeros((GAMES, 9), np.float32)


def small():
    """For quick models; SB3 writes into the mapping it is handed."""
    return {"policy_kwargs": {"net_arch": [16]}, "device": "cpu", "seed": 0}


def make(env_id=ALLY, games=GAMES, **options):
    return make_sb3(env_id, games, **{"scenario": SHORT, **options})


def test_a_rounds_end_has_a_monitors_info_behind_wrappers_too():
    env = VecCheckNan(VecFrameStack(VecNormalize(make(seed=1)), 4))
    assert env.reset().shape == (GAMES, 60)
    for _ in range(STEPS):
        *_, dones, infos = env.step(REST)
        assert all(bool(info) == dones[0] for info in infos)
    for info in infos:
        assert info["TimeLimit.truncated"] is True
        assert info["terminal_observation"].shape == (60,)
        assert info["episode"]["l"] == STEPS
        assert {"t", "outage", "jamming_success_rate", "hop_rate", "snr_db"} <= info["episode"].keys()


def test_seeds_are_for_the_next_reset():
    env = make()
    assert env.seed(5) == check_seeds(5, GAMES).tolist()
    first = env.reset()
    assert not np.array_equal(first, env.reset())
    assert np.array_equal(first, make(seed=5).reset())
    assert len(env.seed()) == GAMES


def test_a_staggered_batch_cuts_its_first_rounds_alone():
    env = make(games=4, seed=0, stagger=True)
    lengths = env.core.duel.batch.games["horizon"]
    for expected in ([STEPS, STEPS * 3 // 4, STEPS // 2, STEPS // 4], [STEPS] * 4):
        env.reset()
        assert lengths.tolist() == expected


def test_a_new_match_can_be_asked_for():
    env = make(seed=5)
    curves = env.core.duel.batch.games["control_points"]
    env.reset()
    first = curves.copy()
    env.set_options({"new_match": True})
    env.reset()
    assert not np.array_equal(first, curves)
    with pytest.raises(UserError, match="unknown option 'match'"):
        env.set_options({"match": True})


def test_attributes_and_methods_are_within_reach():
    env = make(seed=0)
    env.reset()
    env.step(REST)
    assert env.get_attr("scenario") == [SHORT] * GAMES
    assert env.get_attr("render_mode", indices=[0, 2]) == [None, None]
    assert [found["hop_rate"] for found in env.env_method("measures", indices=[1])] == [0.0]
    assert len(env.env_method("advice")) == GAMES
    env.set_attr("note", "mine")
    assert env.get_attr("note", 0) == ["mine"]
    with pytest.raises(ValueError, match="for all 3 games at once"):
        env.set_attr("note", "yours", indices=[0])
    with pytest.raises(AttributeError, match="nothing_like_it"):
        env.get_attr("nothing_like_it")
    assert env.env_is_wrapped(Monitor) == [True] * GAMES
    assert env.env_is_wrapped(gymnasium.wrappers.TimeLimit, indices=0) == [False]


@pytest.mark.slow
def test_evaluate_policy_reads_whole_rounds_behind_normalisation():
    env = VecNormalize(make(seed=0), training=False)
    model = PPO("MlpPolicy", env, n_steps=STEPS, batch_size=32, **small())
    returns, lengths = evaluate_policy(model, env, n_eval_episodes=4, return_episode_rewards=True)
    assert lengths == [STEPS] * 4
    env.seed(0)
    assert evaluate_policy(model, env, n_eval_episodes=3, return_episode_rewards=True)[0] == returns[:3]


@pytest.mark.slow
def test_an_off_policy_algorithm_learns_a_few_steps():
    model = SAC("MlpPolicy", make(), learning_starts=100, batch_size=32, buffer_size=1000, **small())
    model.learn(120)
    ends = model.replay_buffer.dones[: model.replay_buffer.pos].astype(bool)
    assert ends.any()
    # A time limit is no end of the game: it must be bootstrapped through
    assert np.array_equal(model.replay_buffer.timeouts[: model.replay_buffer.pos].astype(bool), ends)


@pytest.mark.parametrize("env_id", [ALLY_POLICY, OPPONENT_POLICY])
def test_a_model_of_sb3_plays_the_other_side(env_id):
    other = "opponent" if env_id == ALLY_POLICY else "ally"
    trained_on = OPPONENT_POLICY if env_id == ALLY_POLICY else ALLY_POLICY
    model = PPO("MlpPolicy", make(trained_on), **small())
    env = make(env_id, seed=0, **{other: [model, "random"]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert gymnasium.make(env_id, **{other: model}).spec.kwargs[other] is not None
    env.reset()
    for action in tape(GAMES, STEPS):
        *_, dones, _ = env.step(action)
    assert dones.all()


@pytest.mark.slow
def test_the_first_game_can_be_filmed(tmp_path):
    pytest.importorskip("moviepy", reason="moviepy is in the extra video")
    environment = make_sb3(ALLY, n_envs=2, seed=1, render_mode="rgb_array", scenario=SHORT)
    filmed = VecVideoRecorder(
        environment, str(tmp_path), record_video_trigger=lambda step: step == 0, video_length=2
    )
    filmed.reset()
    for _ in range(3):
        filmed.step(np.zeros((2, 9), np.float32))
    filmed.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1_000
