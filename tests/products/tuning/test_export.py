"""Confirmed values, written into hyper-parameter files."""

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.tuning.export import Confirmed, write_values
from fpg_bench.training.hyperparameters import load_hyperparameters
from tests.products.tuning.fake import fake_task

VALUES = {"learning_rate": 0.0001235, "gamma": 0.98, "policy_kwargs.net_arch": [128, 128]}
ALLY, OPPONENT = "FPG/AllyVsScripted-v0", "FPG/OpponentVsScripted-v0"


def confirmed(env_id, values=VALUES):
    task = fake_task(game=GameSpec(env_id), steps=1_500_000, rounds=100, hyperparameters={"n_envs": 2})
    score = Interval(61.234, 58.0, 64.5, "training seeds")
    return Confirmed("ppo on it", 20, 7, values, 65.43, score, range(200_000, 200_003), task)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "ppo.yml"
    path.write_text((baselines_folder() / "hyperparams" / "ppo.yml").read_text())
    return path


def read(path):
    return yaml.safe_load(path.read_text())


@pytest.mark.parametrize("env_id", [ALLY, OPPONENT])
def test_values_are_written_and_everything_else_stays(file, env_id):
    before, comment = read(file), file.read_text().splitlines()[0]
    write_values(file, confirmed(env_id))
    after = read(file)
    assert file.read_text().splitlines()[0] == comment
    old, entry = before[env_id], after[env_id]
    tuned = {"learning_rate": 0.0001235, "gamma": 0.98}
    assert entry == old | tuned | {"policy_kwargs": old["policy_kwargs"] | {"net_arch": [128, 128]}}
    follow = {name: entry for name in before if before[name] == old}  # its aliases
    assert after == before | follow
    assert load_hyperparameters("ppo", env_id, file).algorithm["gamma"] == 0.98


def test_where_they_come_from_stands_above_them(file):
    write_values(file, confirmed(ALLY))
    text = " ".join(line.strip("# ") for line in file.read_text().splitlines() if line.startswith("  #"))
    for said in (
        "study 'ppo on it', trial 7 (of 20): score 61.2 [58.0, 64.5]",
        "fresh training seeds 200000 to 200002 of 1,500,000 steps each, 65.4 in the study",
        "suite ally-v1 on tuning seeds, 100 rounds per rival",
        "stable-baselines3 2.",
        "optuna 5.",
    ):
        assert said in text
    assert all(len(line) <= 110 for line in file.read_text().splitlines())


def test_written_again_it_holds_the_last_only(file):
    write_values(file, confirmed(ALLY))
    write_values(file, confirmed(OPPONENT))
    once = file.read_text()
    write_values(file, confirmed(ALLY))
    write_values(file, confirmed(OPPONENT))
    assert file.read_text() == once
    assert once.count("# tuned:") == 2


def test_keys_over_several_lines_and_comments_within(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text(
        f"# mine\n{ALLY}:\n  # kept\n  gamma: 0.9  # old\n  policy_kwargs:\n    net_arch: [8]\n"
        f"    log_std_init: -1.0\n  n_envs: 4  # kept too\n\n# others\n{OPPONENT}: {{n_envs: 5}}\n"
    )
    write_values(path, confirmed(ALLY))
    text = path.read_text()
    assert "  # kept\n" in text
    assert "  n_envs: 4  # kept too\n" in text
    assert text.endswith(f"# others\n{OPPONENT}: {{n_envs: 5}}\n")
    assert "# old" not in text
    assert read(path)[ALLY]["policy_kwargs"] == {"net_arch": [128, 128], "log_std_init": -1.0}
    assert read(path)[ALLY]["learning_rate"] == 0.0001235


def test_an_entry_or_file_that_is_not_there_is_made(tmp_path):
    path = tmp_path / "new.yml"
    write_values(path, confirmed(ALLY))
    tuned = {"learning_rate": 0.0001235, "gamma": 0.98, "policy_kwargs": {"net_arch": [128, 128]}}
    assert read(path) == {ALLY: {"n_envs": 2, **tuned}}
    write_values(path, confirmed(OPPONENT))
    assert read(path).keys() == {ALLY, OPPONENT}


def test_a_file_that_cannot_be_edited_is_left_as_it_is(tmp_path):
    path = tmp_path / "mine.yml"
    for text in (f'"{ALLY}":\n  gamma: 0.9\n', f"{ALLY}: {{\n  gamma: 0.9,\n  n_envs: 4\n}}\n"):
        path.write_text(text)
        with pytest.raises(UserError, match=r"cannot be edited.*0.98"):
            write_values(path, confirmed(ALLY))
        assert path.read_text() == text
