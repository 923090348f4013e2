"""Training loops of one's own: scores on tuning seeds, their files, and a warning at held-out seeds."""

import logging

import numpy as np
import pytest

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation import evaluate as evaluating
from fpg_bench.products.rendering.curves import curves, read_runs


class Still:
    """A model in training."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 9), np.float32), state


def test_logged_scores_become_one_curve_of_all_seeds(tmp_path):
    for seed in (0, 1):
        for steps in (0, 100, 200):
            row = fpg_bench.log_evaluation(tmp_path / f"seed_{seed}", Still(), steps, steps / 50, rounds=1)
    assert row["score"] == fpg_bench.PolicyEvaluator("ally-v2", rounds=1).score(Still())["score"]
    rows = read_runs([tmp_path])
    assert {each["training_seed"] for each in rows} == {0, 1}
    assert curves(rows, "steps")["Still"].x[[0, -1]] == pytest.approx([100, 200])


def test_a_folder_keeps_the_scores_of_one_training(tmp_path):
    fpg_bench.log_evaluation(tmp_path / "own", Still(), 100, 1.0, rounds=1)
    before = (tmp_path / "own/evaluations.jsonl").read_bytes()
    with pytest.raises(UserError, match="has a score of 100 steps already"):
        fpg_bench.log_evaluation(tmp_path / "own", Still(), 100, 1.0, rounds=1)
    with pytest.raises(UserError, match="seconds: expected a finite number, 0 or more, got nan"):
        fpg_bench.log_evaluation(tmp_path / "late", Still(), 1, float("nan"))
    with pytest.raises(UserError, match="training of another algorithm; choose another folder"):
        fpg_bench.log_evaluation(tmp_path / "own", Still(), 200, 1.0, rounds=1, algorithm="other")
    assert (tmp_path / "own/evaluations.jsonl").read_bytes() == before
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UserError, match="holds other files, but no training run"):
        fpg_bench.log_evaluation(tmp_path, Still(), 100, 1.0)


def test_a_loop_over_evaluation_seeds_is_warned_of_once(monkeypatch, caplog):
    monkeypatch.setattr(evaluating, "_live", evaluating.Counter())
    caplog.set_level(logging.WARNING, "fpg_bench")
    monkeypatch.setattr(logging.getLogger("fpg_bench"), "propagate", True)
    for _ in range(4):
        fpg_bench.evaluate(["idle"], "ally-v2", matches=1)
    assert not caplog.records
    for _ in range(5):
        fpg_bench.evaluate({"mine": Still()}, "ally-v2", matches=1)
    (record,) = caplog.records
    assert "PolicyEvaluator" in record.message
