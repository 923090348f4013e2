"""Agents that see a waterfall: exported, evaluated, trained and submitted as others are."""

from __future__ import annotations

import dataclasses
import hashlib
import json

import numpy as np
import pytest
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import VecNormalize

from fpg_bench import evaluate, export_agent, load_agent, make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import STANDARD, as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.preprocessing import preprocessing_of
from fpg_bench.players.registry import ModelPlayer, as_player
from fpg_bench.products.checkers import check_player
from fpg_bench.training.export import exported_player
from fpg_bench.training.waterfall_cnn import WaterfallCNN
from tests.training.test_export import check_plays_alike
from tests.training.tiny import ALLY, settings, train_tiny

CNN = {"features_extractor_class": "fpg_bench.training.waterfall_cnn:WaterfallCNN"}
WATERFALL = {"observation": "waterfall", "history": 6, "actions": "discrete"}


def make_model(algorithm, policy="MlpPolicy", norm_obs=False, policy_kwargs=None, **options):
    """A model with random weights that are large enough for its choices to vary."""
    games = make_sb3(ALLY, 4, seed=1, **(WATERFALL | options))
    if norm_obs:
        games = VecNormalize(games)
        games.reset()
        for _ in range(30):
            games.step(np.array([games.action_space.sample() for _ in range(4)]))
    model = algorithm(policy, games, seed=0, device="cpu", policy_kwargs=policy_kwargs)
    for parameter in model.policy.parameters():
        noise = np.random.default_rng(1).normal(size=parameter.shape)
        parameter.data += 0.5 * parameter.data.new_tensor(noise)
    return model


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "options"),
    [
        (DQN, {}),
        (DQN, {"scenario": "link"}),
        (PPO, {"policy_kwargs": {"features_extractor_class": WaterfallCNN}}),
        (PPO, {"actions": "continuous", "norm_obs": True}),
        (MaskablePPO, {"scenario": as_scenario(None, knowledge="none"), "history": 1}),
        (RecurrentPPO, {"policy": "MlpLstmPolicy", "policy_kwargs": {"lstm_hidden_size": 6}}),
    ],
    ids=["dqn", "dqn-link", "ppo-cnn", "ppo-continuous", "masked", "lstm"],
)
def test_agents_play_as_the_model_does_in_its_own_games(algorithm, options, tmp_path):
    """Over rounds that end at different steps; through onnxruntime, live, and by predict."""
    model = make_model(algorithm, **options)
    assert export_agent(model, tmp_path, training_seed=0) < 1e-4
    agent = load_agent(tmp_path)
    words = {name: options[name] for name in ("scenario", "actions", "history") if name in options}
    games = make_sb3(ALLY, 4, seed=5, stagger=True, **(WATERFALL | words))
    players = [agent, exported_player(model)]
    if not options.get("norm_obs"):  # predict itself does not normalize
        players.append(ModelPlayer(model, games.core.choices, preprocessing_of(model, games.core.waterfall)))
    check_plays_alike(model, players, games, 160)


@pytest.mark.full
def test_a_model_and_its_agent_score_the_same_and_the_agent_may_be_submitted(tmp_path):
    model = make_model(DQN)
    export_agent(model, tmp_path / "agent", training_seed=0)
    agent = load_agent(tmp_path / "agent")
    scores = [row.score for row in evaluate({"model": model, "agent": agent}, "ally-v2", matches=2)]
    assert scores[0] == scores[1]
    check_player(agent, "ally")
    check_player(as_player(model, "ally", as_scenario(None)), "ally")
    playing = pytest.importorskip("fpg_bench.products.leaderboard.playing")
    client = pytest.importorskip("fpg_bench.products.sandbox.client")
    data = (tmp_path / "agent" / "policy.onnx").read_bytes()
    policy = client.Policy(0, None, data, hashlib.sha256(data).hexdigest())
    assert playing.smoke_test(policy, load_suite("ally-v2")) == []


def test_models_that_see_something_else_are_refused(tmp_path):
    model, continuous = make_model(DQN), make_model(PPO, actions="continuous")
    with pytest.raises(UserError, match=r"opponent: PPO sees \(6, 20\), the opponent here 15 numbers"):
        as_player(continuous, "opponent", as_scenario(None))
    with pytest.raises(UserError, match=r"DQN sees \(6, 20\), the ally here a waterfall of \(6, 10\)"):
        as_player(model, "ally", dataclasses.replace(STANDARD, bandwidth_mhz=10.0))
    model.save(tmp_path / "model.zip")
    game = GameSpec(ALLY, scenario="standard", actions="discrete")
    with pytest.raises(UserError, match="not the waterfall of its games"):
        export_agent(DQN.load(tmp_path / "model.zip"), tmp_path, training_seed=0, game=game)
    continuous.save(tmp_path / "ppo.zip")
    zips = pytest.importorskip("fpg_bench.products.sb3_zip.zip_file")
    with pytest.raises(UserError, match=r"it sees a waterfall of \(6, 20\)"):
        zips.load_zip(tmp_path / "ppo.zip", "ppo", ALLY)


@pytest.mark.full
@pytest.mark.slow
def test_runs_are_repeatable_and_are_no_stacks(tmp_path):
    changes = {"normalize": None, "policy_kwargs": {"net_arch": [8]}}
    runs = [train_tiny("dqn", tmp_path / name, changes, **WATERFALL) for name in ("a", "b")]
    assert len({(run / "policy.onnx").read_bytes() for run in runs}) == 1
    about = json.loads((tmp_path / "a" / "run.json").read_text())
    assert about["game"] == {"id": ALLY} | WATERFALL
    with pytest.raises(UserError, match="a waterfall is already a stack; set its history"):
        train_tiny("dqn-stack3", tmp_path / "stack", settings("dqn"), **WATERFALL)


@pytest.mark.full
@pytest.mark.slow
def test_a_teacher_that_sees_the_numbers_is_imitated_from_the_waterfall(tmp_path):
    lesson = {"teacher": "idle", "steps": 3000, "learning_rate": 0.003, "batch_size": 128}
    changes = {"normalize": None, "n_envs": 8, "policy_kwargs": {"net_arch": [32]}, "imitate": lesson}
    train_tiny("ppo", tmp_path, changes, **WATERFALL)
    assert json.loads((tmp_path / "run.json").read_text())["imitation_error"] < 0.05  # share of choices
