"""Wrappers between a game and a policy are folded into every player, or refused by name."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import (
    FlattenObservation,
    FrameStackObservation,
    TimeAwareObservation,
    TransformAction,
    TransformObservation,
    TransformReward,
)
from sb3_contrib import MaskablePPO, RecurrentPPO
from sb3_contrib.common.wrappers import ActionMasker
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import (
    SubprocVecEnv,
    VecEnvWrapper,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

import fpg_bench
from fpg_bench import evaluate, export_agent, make_sb3, supersuit_vec_env
from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import VecMemory
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import load_agent
from fpg_bench.players.preprocessing import difference_in_own_games, preprocessing_of
from fpg_bench.players.registry import ModelPlayer, as_player
from fpg_bench.products.checkers import check_player
from tests.training.tiny import ALLY


def a_model(games, kind=PPO, **options):
    """A model with random weights that are large enough for its actions to depend on what it sees."""
    policy = "MlpLstmPolicy" if kind is RecurrentPPO else "MlpPolicy"
    kwargs = {"net_arch": [16], **({"lstm_hidden_size": 6} if kind is RecurrentPPO else {})}
    model = kind(policy, games, seed=0, policy_kwargs=kwargs, device="cpu", **options)
    rng = np.random.default_rng(1)
    for weights in model.policy.parameters():
        weights.data += 0.3 * weights.data.new_tensor(rng.normal(size=weights.shape))
    return model


def learned(games):
    """Games whose statistics have seen a hundred steps."""
    games.reset()
    for _ in range(100):
        games.step(np.random.default_rng(0).uniform(-1, 1, (games.num_envs, 9)).astype(np.float32))
    return games


def sb3(**options):
    return make_sb3(ALLY, 4, seed=1, **options)


def normalized():
    return VecNormalize(sb3())


CHAINS = {
    "normalized": normalized,
    "stacked": lambda: VecFrameStack(sb3(), 3),
    "stacked-normalized": lambda: VecNormalize(VecFrameStack(sb3(), 3)),
    "normalized-stacked": lambda: VecFrameStack(normalized(), 3),  # rl-zoo3's order
    "normalized-stacked-normalized": lambda: VecNormalize(VecFrameStack(normalized(), 3)),
    "memory": lambda: VecMemory(sb3()),
    "stacked-memory-normalized": lambda: VecNormalize(VecMemory(VecFrameStack(sb3(), 3))),
    "rewards-only": lambda: VecNormalize(sb3(), norm_obs=False),
    "monitored": lambda: VecMonitor(normalized()),
}


@pytest.mark.slow
@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("kind", [PPO, SAC, RecurrentPPO])
def test_a_live_model_and_its_agent_play_as_the_model_does_in_its_own_games(chain, kind, tmp_path):
    model = a_model(learned(CHAINS[chain]()), kind)
    assert export_agent(model, tmp_path, training_seed=0) < 1e-4
    agent, live = load_agent(tmp_path), as_player(model, "ally", STANDARD)
    by_predict = ModelPlayer(model, None, preprocessing_of(model))
    for player in (agent, live, by_predict):
        assert difference_in_own_games(model, player) < 1e-4
    naked = a_model(sb3(), kind)
    if chain in ("normalized", "monitored"):
        naked.policy.load_state_dict(model.policy.state_dict())
        assert difference_in_own_games(model, naked) > 0.01


def test_a_live_model_scores_as_its_exported_agent(tmp_path):
    model = a_model(learned(normalized()))
    export_agent(model, tmp_path, training_seed=0)
    check_player(model, "ally")
    by_predict = ModelPlayer(model, None, preprocessing_of(model))
    players = {"live": model, "agent": str(tmp_path), "predict": by_predict}
    scores = {row.entry: row.score.value for row in evaluate(players, "ally-v2", matches=1)}
    assert scores["live"] == scores["agent"] == pytest.approx(scores["predict"], abs=0.01)


def test_the_self_check_leaves_the_models_games_as_they_were(tmp_path):
    games, twin = learned(normalized()), learned(normalized())
    model = a_model(games)
    export_agent(model, tmp_path, training_seed=0)
    actions = np.zeros((4, 9), np.float32)
    for one, other in zip(games.step(actions)[:3], twin.step(actions)[:3], strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(games.obs_rms.mean, twin.obs_rms.mean)
    assert games.training


class Flipped(gymnasium.Wrapper):
    """A wrapper whose class does not say that it changes observations."""

    def reset(self, **options):
        seen, info = self.env.reset(**options)
        return -seen, info

    def step(self, action):
        seen, *rest = self.env.step(action)
        return -seen, *rest


class Skipping(gymnasium.Wrapper):
    def step(self, action):
        self.env.step(action)
        return self.env.step(action)


class Halved(gymnasium.Wrapper):
    def step(self, action):
        return self.env.step(action / 2)


class Shaped(gymnasium.Wrapper):
    """A wrapper that changes rewards only."""

    def step(self, action):
        seen, reward, *rest = self.env.step(action)
        return seen, reward - 1, *rest


class VecFlipped(VecEnvWrapper):
    def reset(self):
        return -self.venv.reset()

    def step_wait(self):
        seen, *rest = self.venv.step_wait()
        return -seen, *rest


def gym_games(wrapper=None, **options):
    return make_vec_env(f"fpg_bench:{ALLY}", 2, seed=0, wrapper_class=wrapper, **options)


def negative(env):
    return TransformObservation(env, np.negative, env.observation_space)


def stacked(env):
    return FlattenObservation(FrameStackObservation(env, 3))


REFUSED = {
    "TransformObservation, which no player has": lambda: gym_games(negative),
    "TransformAction, which no player has": lambda: gym_games(
        lambda env: TransformAction(env, np.negative, env.action_space)
    ),
    "Flipped of its games change": lambda: gym_games(Flipped),
    "Skipping of its games change": lambda: gym_games(Skipping),
    "Halved of its games change": lambda: VecNormalize(gym_games(Halved)),
    "VecFlipped of its games change": lambda: VecFlipped(sb3()),
    r"TimeAwareObservation": lambda: gym_games(TimeAwareObservation),
    r"FlattenObservation": lambda: gym_games(stacked),
    "frames can be stacked once": lambda: VecFrameStack(VecFrameStack(sb3(), 2), 2),
    "frames can be stacked once, under VecMemory": lambda: VecFrameStack(VecMemory(sb3()), 2),
    "VecMemory stands once, on the games": lambda: VecMemory(normalized()),
}


@pytest.mark.parametrize("message", REFUSED)
def test_wrappers_that_no_player_has_are_refused_by_name(message, tmp_path):
    model = a_model(REFUSED[message]())
    for use in (
        lambda: as_player(model, "ally", STANDARD),
        lambda: export_agent(model, tmp_path / "agent", training_seed=0),
    ):
        with pytest.raises(UserError, match=message) as raised:
            use()
        assert "VecFrameStack" in str(raised.value) or "once" in message
    assert not (tmp_path / "agent").exists()


@pytest.mark.parametrize("wrapper", [None, Shaped, lambda env: TransformReward(env, abs)])
def test_wrappers_of_rewards_are_no_obstacle(wrapper, tmp_path):
    model = a_model(VecNormalize(gym_games(wrapper)))
    assert export_agent(model, tmp_path, training_seed=0) < 1e-4
    assert difference_in_own_games(model, as_player(model, "ally", STANDARD)) < 1e-4


def test_masks_of_ones_own_are_no_part_of_a_player(tmp_path):
    def masked(env):
        return ActionMasker(env, lambda env: np.arange(env.action_space.n) < 3)

    games = gym_games(masked, env_kwargs={"actions": "discrete"})
    model = MaskablePPO("MlpPolicy", games, seed=0, device="cpu")
    model.policy.action_net.bias.data[7] = 9
    with pytest.raises(UserError, match="ActionMasker of its games change"):
        export_agent(model, tmp_path, training_seed=0)


@pytest.mark.process
def test_games_in_other_processes_are_judged_by_the_names_of_their_wrappers(tmp_path):
    games = gym_games(vec_env_cls=SubprocVecEnv)
    assert export_agent(a_model(games), tmp_path, training_seed=0) < 1e-4
    games.close()
    games = gym_games(Flipped, vec_env_cls=SubprocVecEnv)
    with pytest.raises(UserError, match="Flipped of its games can't be copied"):
        as_player(a_model(games), "ally", STANDARD)
    games.close()


def test_a_model_that_lost_its_statistics_is_refused(tmp_path):
    model = a_model(normalized(), n_steps=64, batch_size=64)
    model.learn(256)
    assert np.abs(model._last_obs).max() > 1
    model.save(tmp_path / "model.zip")
    loaded = PPO.load(tmp_path / "model.zip", device="cpu")
    with pytest.raises(UserError, match=r"trained with VecNormalize, .* PPO.load\(path, env=VecNormalize"):
        as_player(loaded, "ally", STANDARD)
    with pytest.raises(UserError, match="was trained with VecNormalize"):
        export_agent(loaded, tmp_path / "agent", training_seed=0, game=GameSpec(ALLY, scenario="standard"))
    model.get_env().save(str(tmp_path / "statistics.pkl"))
    games = VecNormalize.load(str(tmp_path / "statistics.pkl"), make_sb3(ALLY))
    loaded = PPO.load(tmp_path / "model.zip", env=games, device="cpu")
    assert export_agent(loaded, tmp_path / "agent", training_seed=0) < 1e-4
    expected = as_player(model, "ally", STANDARD)
    assert difference_in_own_games(model, as_player(loaded, "ally", STANDARD)) < 1e-4
    assert difference_in_own_games(loaded, expected) < 1e-4


def test_a_stacked_model_without_its_games_is_known_by_its_size(tmp_path):
    model = a_model(VecFrameStack(sb3(), 3))
    model.save(tmp_path / "model.zip")
    loaded = PPO.load(tmp_path / "model.zip", device="cpu")
    assert difference_in_own_games(model, as_player(loaded, "ally", STANDARD)) < 1e-4


@pytest.mark.parametrize("kind", [torch.float64, torch.bfloat16])
def test_weights_of_another_precision_are_refused_with_the_remedy(kind, tmp_path):
    model = a_model(sb3())
    model.policy.to(kind)
    for use in (as_player, lambda *_: export_agent(model, tmp_path, training_seed=0)):
        with pytest.raises(UserError, match=rf"weights are {kind}.*model.policy.float\(\)"):
            use(model, "ally", STANDARD)


def test_a_joint_model_is_no_player_of_one_side():
    model = pytest.importorskip("fpg_bench.products.maddpg.maddpg").MADDPG(
        "JointPolicy", make_sb3("FPG/duel_v0", 1), buffer_size=10
    )
    with pytest.raises(UserError, match=r"observations of shape \(30,\)"):
        as_player(model, "ally", STANDARD)
    assert as_player(model.players[0], "ally", STANDARD) is not None


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_one_policy_of_both_sides_is_exported_for_either(side, tmp_path):
    model = a_model(VecNormalize(supersuit_vec_env(2, seed=0)))
    with pytest.raises(UserError, match="give the game"):
        export_agent(model, tmp_path, training_seed=0)
    id = {"ally": ALLY, "opponent": "FPG/OpponentVsScripted-v0"}[side]
    game = GameSpec(id, scenario="standard")
    assert export_agent(model, tmp_path, training_seed=0, game=game) < 1e-4
    seen = np.random.default_rng(0).uniform(-1, 1, (20, 15)).astype(np.float32)
    live = as_player(model, side, STANDARD).predict(seen)[0]
    assert np.abs(fpg_bench.load_agent(tmp_path).predict(seen)[0] - live).max() < 1e-4
