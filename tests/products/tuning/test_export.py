"""Confirmed values, written into a file of hyper-parameters."""

import yaml

from fpg_bench.evaluation.statistics import Interval
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.tuning.export import Confirmed, write_values
from fpg_bench.training.hyperparameters import load_hyperparameters
from tests.products.tuning.fake import fake_task

VALUES = {"learning_rate": 0.0001235, "gamma": 0.98, "policy_kwargs.net_arch": [128, 128]}
ALLY, OPPONENT = "FPG/AllyVsScripted-v0", "FPG/OpponentVsScripted-v0"


def confirmed(env_id, values=VALUES):
    task = fake_task(game=GameSpec(env_id), steps=1_500_000, rounds=100, hyperparameters={"n_envs": 2})
    score = Interval(61.234, 58.0, 64.5, "training seeds")
    return Confirmed("ppo on it", 20, 7, values, 65.43, score, range(200_000, 200_003), task)


def read(path):
    return yaml.safe_load(path.read_text())


def test_the_values_of_the_trial_stand_among_those_of_the_study(tmp_path):
    file = tmp_path / "new.yml"
    write_values(file, confirmed(ALLY))
    tuned = {"learning_rate": 0.0001235, "gamma": 0.98, "policy_kwargs": {"net_arch": [128, 128]}}
    assert read(file) == {ALLY: {"n_envs": 2, **tuned}}
    assert load_hyperparameters("ppo", ALLY, file).algorithm["gamma"] == 0.98


def test_where_they_come_from_stands_above_them(tmp_path):
    file = tmp_path / "new.yml"
    write_values(file, confirmed(ALLY))
    text = " ".join(line.strip("# ") for line in file.read_text().splitlines() if line.startswith("  #"))
    for said in (
        "study 'ppo on it', trial 7 (of 20): score 61.2 [58.0, 64.5]",
        "fresh training seeds 200000 to 200002 of 1,500,000 steps each, 65.4 in the study",
        "suite ally-v2 on tuning seeds, 100 rounds per rival",
        "stable-baselines3 2.",
        "optuna 5.",
    ):
        assert said in text
    assert all(len(line) <= 110 for line in file.read_text().splitlines())
