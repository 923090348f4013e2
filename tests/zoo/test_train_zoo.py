"""How the zoo is trained; a stand-in trains here, the real thing in tests/test_zoo.py."""

import json
import os
import signal
import threading
import time
from functools import partial

import pytest

from fpg_bench.errors import UserError
from fpg_bench.jobs.run import Workers, run_jobs, run_quietly
from fpg_bench.zoo import training
from fpg_bench.zoo.curves import curve_file
from fpg_bench.zoo.scores import score_file
from fpg_bench.zoo.training import run_folder, run_spec, ship, state, train_zoo
from tests.zoo.making import make_agent, make_zoo
from tests.zoo.standing_in import stand_in


@pytest.fixture
def zoo(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "train", partial(stand_in, tmp_path))
    monkeypatch.setattr(training, "run_jobs", in_turn)
    return make_zoo(tmp_path)


def in_turn(jobs, workers, say):
    """As ``run_jobs``, but one after the other, in this process."""
    for name, error in run_quietly(jobs, Workers()).items():
        say(f"{name}: failed: {error}")


def begun(zoo):
    file = zoo.folder / "begun"
    return file.read_text().split() if file.exists() else []


def test_a_run_is_what_the_zoo_says(zoo):
    spec = run_spec(zoo.members()[1])
    assert (spec.algorithm, spec.id, spec.seed, spec.steps) == ("ppo", "FPG/AllyVsScripted-v0", 1, 2000)
    assert spec.game.to_dict() == {"path": ["pursuit", "circle"]}
    assert [spec.field] == list(zoo.views[0].fields)


def test_what_is_missing_is_trained_shipped_and_scored_once(zoo, tmp_path):
    said, runs = [], tmp_path / "runs"
    make_agent(zoo.members()[0])
    assert train_zoo(zoo, runs, only="small/ppo", jobs=2, say=said.append) == []
    assert sorted(begun(zoo)) == ["1", "2"]
    assert [state(member, runs) for member in zoo.members()] == ["shipped"] * 3 + ["missing"] * 3
    assert sum(line.endswith(": shipped") for line in said) == 2
    assert {row["training_seed"] for row in curve_file(zoo, zoo.views[0]).read()} == {1, 2}
    scored = [row for row in score_file(zoo, zoo.views[0]).read() if row["entry"] == "ppo"]
    assert {row["training_seed"] for row in scored} == {0, 1, 2}
    train_zoo(zoo, runs, only="small/ppo", say=said.append)
    assert len(begun(zoo)) == 2


def test_one_that_fails_does_not_hold_up_the_others(zoo, tmp_path):
    said = []
    (tmp_path / "break_0").touch()
    assert train_zoo(zoo, tmp_path / "runs", only="small/ppo", jobs=1, say=said.append) == [
        "small/ppo/seed_0"
    ]
    assert "small/ppo/seed_0: failed: out of luck" in said
    assert [member.shipped for member in zoo.members("small/ppo")] == [False, True, True]
    (tmp_path / "break_0").unlink()
    assert train_zoo(zoo, tmp_path / "runs", only="small/ppo", say=said.append) == []


@pytest.mark.slow
def test_ctrl_c_stops_the_trainings_and_the_next_call_goes_on(zoo, tmp_path, monkeypatch):
    monkeypatch.setattr(training, "run_jobs", run_jobs)
    runs = tmp_path / "runs"
    for seed in range(3):
        (tmp_path / f"hold_{seed}").touch()

    def stop():
        while len(begun(zoo)) < 2:
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            train_zoo(zoo, runs, only="small/ppo", jobs=2, say=lambda line: None)
    finally:
        signal.signal(signal.SIGINT, before)
    members = zoo.members("small/ppo")
    assert [(run_folder(member, runs) / "saved").exists() for member in members] == [True, True, False]
    assert [state(member, runs) for member in members] == ["begun", "begun", "missing"]
    for seed in range(3):
        (tmp_path / f"hold_{seed}").unlink()
    monkeypatch.setattr(training, "run_jobs", in_turn)
    assert train_zoo(zoo, runs, only="small/ppo", say=lambda line: None) == []
    assert all(member.shipped for member in members)


@pytest.mark.parametrize("key", ["training_seed", "training_steps", "id"])
def test_an_agent_of_another_budget_is_not_shipped(zoo, tmp_path, key):
    member = zoo.members()[0]
    make_agent(member, tmp_path / "run" / "agent", **{key: "FPG/OpponentVsScripted-v0" if key == "id" else 7})
    with pytest.raises(UserError, match=f"{key} is .*, the zoo asks for"):
        ship(member, tmp_path / "run")
    assert not member.shipped


def test_a_truncated_agent_is_not_shipped(zoo, tmp_path):
    member = zoo.members()[0]
    folder = make_agent(member, tmp_path / "run" / "agent")
    (folder / "policy.onnx").write_bytes((folder / "policy.onnx").read_bytes()[:100])
    with pytest.raises(UserError, match="sha256"):
        ship(member, tmp_path / "run")
    assert not member.shipped


def test_states(zoo, tmp_path):
    member, runs = zoo.members()[0], tmp_path / "runs"
    assert state(member, runs) == "missing"
    folder = run_folder(member, runs)
    folder.mkdir(parents=True)
    for finished, word in ((False, "begun"), (True, "trained")):
        (folder / "run.json").write_text(json.dumps({"finished": finished}))
        assert state(member, runs) == word
    make_agent(member, folder / "agent")
    ship(member, folder)
    assert state(member, runs) == "shipped"


def test_bad_words(zoo, tmp_path):
    with pytest.raises(UserError, match="jobs: expected a whole number above 0, got 0"):
        train_zoo(zoo, tmp_path / "runs", jobs=0)
    with pytest.raises(UserError, match="the zoo has no 'large'"):
        train_zoo(zoo, tmp_path / "runs", only="large")
