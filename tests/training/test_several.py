"""Several training seeds at once."""

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.players.agent import load_agent
from fpg_bench.training.train import parse_seeds, train_seeds
from tests.training.tiny import run_config, settings


def train(out, seeds, *, workers=2, **options):
    lines = []
    config = run_config("ppo", **{"hyperparams": settings("ppo")} | options)
    train_seeds(config, out, seeds, evaluations=0, workers=workers, say=lines.append)
    return lines


@pytest.mark.process
def test_each_seed_is_trained_once_and_one_that_fails_does_not_hold_up_the_others(tmp_path):
    (tmp_path / "seed_2").mkdir()
    (tmp_path / "seed_2" / "mine.txt").touch()
    with pytest.raises(UserError, match=r"seed_2: .*is not empty and no run's folder"):
        train(tmp_path, [0, 2], workers=1)
    (tmp_path / "seed_2" / "mine.txt").unlink()
    lines = train(tmp_path, [0, 2], workers=1)
    names = [line.split(":")[0] for line in lines if not line.startswith("under way")]  # on a slow machine
    assert names == ["seed_2", "seed_2"]
    for seed in (0, 2):
        assert load_agent(tmp_path / f"seed_{seed}" / "agent").about["training_seed"] == seed
    with pytest.raises(UserError, match="seed_0: holds this run with 1,200 steps, and its budget stays"):
        train(tmp_path, [0, 2], steps=2400, workers=1)


@pytest.mark.process
def test_words_are_checked_before_anything_begins(tmp_path):
    with pytest.raises(UserError, match="unknown id 'FPG/AllyVsScripted-v9'"):
        train(tmp_path, [0, 1], env_id="FPG/AllyVsScripted-v9")
    with pytest.raises(UserError, match="a language model plans for one run at a time"):
        train(tmp_path, [0], planner="llm")
    assert not list(tmp_path.glob("seed_*"))


@pytest.mark.parametrize(("text", "seeds"), [("3", [3]), ("0-2", [0, 1, 2]), ("0,4-5", [0, 4, 5])])
def test_seeds_in_words(text, seeds):
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1-", "-1", "3-1", "0,0", "1.5"])
def test_seeds_in_bad_words(text):
    with pytest.raises(UserError, match="seeds: "):
        parse_seeds(text)
