"""Trainings that take turns learn what they learn alone, and the tables say when they passed a bound."""

import math
import sys
from functools import partial
from pathlib import Path

import pytest

from tests.training.tiny import ALLY, settings

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

import measure_time_to_score
import taking_turns
from measure_time_to_score import Setting, reached, seconds_to_pass

N_EVALS = [
    {"cpu_s": 0.0, "wall_s": 0.0, "return": -4.0},
    {"cpu_s": 2.0, "wall_s": 5.0, "return": 4.0},
    {"cpu_s": 4.0, "wall_s": 9.0, "return": 2.0},
]


def test_the_bound_is_passed_between_two_looks():
    assert seconds_to_pass(N_EVALS, "return", 0.0, "cpu_s") == pytest.approx(1.0)
    assert seconds_to_pass(N_EVALS, "return", 0.0, "wall_s") == pytest.approx(2.5)
    assert math.isnan(seconds_to_pass(N_EVALS, "return", 4.1, "cpu_s"))


def test_what_was_reached_is_a_mean_over_trainings_none_of_which_had_ended():
    other = [row | {"return": row["return"] + 2} for row in N_EVALS]
    assert reached([N_EVALS, other], "return", 3.0) == pytest.approx(4.0)
    assert math.isnan(reached([N_EVALS, other[:2]], "return", 3.0))


@pytest.mark.slow
def test_trainings_in_turns_draw_the_numbers_that_they_draw_alone(monkeypatch):
    monkeypatch.setattr(taking_turns, "TURN_S", 0.0)
    together = ends("ppo", "sac", "td3")
    assert together.keys() == {"ppo", "sac", "td3"}
    for name, last in together.items():
        assert last == ends(name)[name]
    assert len({last["seen"] for last in together.values()}) == 3


def test_a_training_that_fails_does_not_stop_the_others(monkeypatch, capsys):
    monkeypatch.setattr(taking_turns, "TURN_S", 0.0)

    def failing():
        raise ValueError("diverged")

    makers = {"bad": failing, "ppo": partial(maker("ppo"), 0, None)}
    found = taking_turns.train_together(makers, weights, 1e9, None)
    assert found.keys() == {"ppo"}
    assert "bad: diverged" in capsys.readouterr().out


@pytest.mark.slow
def test_a_report_is_written_and_nothing_trained_twice(tmp_path, monkeypatch, capsys):
    (tmp_path / "settings.yml").write_text(
        "small: {n_envs: 4, n_steps: 50, batch_size: 50, n_epochs: 1}\n"
        "named: {n_envs: 4, n_steps: 50, batch_size: 50, policy_kwargs.activation_fn: GELU}\n"
    )
    words = [
        "",
        "--settings",
        str(tmp_path / "settings.yml"),
        "--steps",
        "400",
        "--out",
        str(tmp_path / "out"),
    ]
    monkeypatch.setattr(sys, "argv", [*words, "--picture", str(tmp_path / "curves.png")])
    measure_time_to_score.main()
    first = capsys.readouterr().out
    assert "return: expert-spread, the best script, " in first
    assert first.count("| small |") == first.count("| named |") == 2
    rows = (tmp_path / "out" / "rows.jsonl").read_bytes()
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    measure_time_to_score.main()
    assert (tmp_path / "out" / "rows.jsonl").read_bytes() == rows
    assert capsys.readouterr().out in first


def maker(name):
    return Setting(ALLY, name, settings(name)).model


def weights(player):
    """A fingerprint of a policy, instead of a score."""
    return {"seen": round(float(sum(part.detach().abs().sum() for part in player._actor.parameters())), 6)}


def ends(*names):
    """The steps and weights with which trainings end."""
    makers = {name: partial(maker(name), 0, None) for name in names}
    found = taking_turns.train_together(makers, weights, 1e9, None)
    return {name: {key: n_evals[-1][key] for key in ("steps", "seen")} for name, n_evals in found.items()}
