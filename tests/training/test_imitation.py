"""Imitation of a teacher before training."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import load_agent
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.imitation import imitate
from fpg_bench.training.models import make_model
from tests.training.tiny import settings, train_tiny

OPPONENT = "FPG/OpponentVsScripted-v0"
NETS = {"net_arch": [32, 32]}
LESSON = {"teacher": "adaptive", "steps": 10_000, "learning_rate": 0.003, "batch_size": 128}


def pupil(algorithm, **changes):
    parameters = load_hyperparameters(algorithm, OPPONENT, settings(algorithm, **changes))
    games = make_sb3(OPPONENT, parameters.n_envs, 0, True, ally="idle", path="learned")
    return make_model(algorithm, games, parameters, 0), games, parameters


def flown(model, games, steps=250):
    """Return the opponent's distance from the ally in the end, in metres."""
    games.seed(7)
    env = model.get_env()
    seen = env.reset()
    for _ in range(steps):
        seen = env.step(model.predict(seen, deterministic=True)[0])[0]
    return float(np.median(games.core.duel.batch.games["distance_m"]))


@pytest.mark.slow
def test_the_model_flies_as_its_teacher_and_keeps_its_standard_deviation():
    model, games, parameters = pupil(
        "ppo-stack2", policy_kwargs=NETS, n_envs=8, imitate=LESSON, normalize={"norm_obs": False}
    )
    spread = model.policy.log_std.clone()
    before, error = flown(model, games), imitate(model, games, parameters.imitate)
    assert error < 0.25
    assert flown(model, games) < 0.5 * before
    assert bool((model.policy.log_std == spread).all())


@pytest.mark.slow
@pytest.mark.parametrize("actions", ["discrete", "multi-discrete"])
def test_a_model_with_a_list_of_choices_learns_its_teachers(actions):
    game = GameSpec(OPPONENT, ally="idle", path="learned", actions=actions)
    values = settings("ppo", policy_kwargs=NETS, n_envs=8, imitate=LESSON)
    parameters = load_hyperparameters("ppo", game, values)
    games = make_sb3(game, parameters.n_envs, 0, stagger=True)
    model = make_model("ppo", games, parameters, 0)
    before, error = flown(model, games), imitate(model, games, parameters.imitate)
    assert error < 0.3
    assert flown(model, games) < 0.5 * before


@pytest.mark.slow
def test_a_run_imitates_once_and_reports_the_error(tmp_path):
    words = {"imitate": LESSON | {"steps": 400}}
    options = {"path": "learned", "ally": "idle", "steps": 400}
    folder = tmp_path / "run"
    agent = train_tiny("ppo", folder, words, env_id=OPPONENT, **options)
    about = json.loads((folder / "run.json").read_text())
    assert about["hyperparameters"]["imitate"]["teacher"] == "adaptive"
    assert 0 < about["imitation_error"] < 2
    again = train_tiny("ppo", tmp_path / "again", words, env_id=OPPONENT, **options)
    assert load_agent(again).card.policy_sha256 == load_agent(agent).card.policy_sha256
    train_tiny("ppo", tmp_path / "on", words, env_id=OPPONENT, start=folder, **options)
    assert "imitation_error" not in json.loads((tmp_path / "on" / "run.json").read_text())


def test_invalid_imitation_is_refused_before_anything_is_written(tmp_path):
    for algorithm, lesson, message in (
        ("ppo", {"teacher": "adaptve"}, "unknown opponent 'adaptve'; did you mean 'adaptive'"),
        ("sac", {"teacher": "adaptive"}, "only PPO and the like without an LSTM can imitate, not SAC"),
        ("recurrent-ppo", {"teacher": "adaptive"}, "not RecurrentPPO"),
    ):
        options = {"env_id": OPPONENT, "path": "learned", "steps": 400}
        with pytest.raises(UserError, match=message):
            train_tiny(algorithm, tmp_path / "run", {"imitate": lesson}, **options)
    assert not (tmp_path / "run").exists()
