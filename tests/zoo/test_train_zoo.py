"""How the zoo is trained; a stand-in trains here, the real thing in tests/test_zoo.py."""

import json
import os
import signal
import sys
import threading
import time

import pytest

from fpg_bench.errors import UserError
from fpg_bench.zoo import training
from fpg_bench.zoo.curves import curve_file
from fpg_bench.zoo.scores import score_file
from fpg_bench.zoo.training import command, run_folder, ship, state, train_zoo
from tests.zoo.making import make_agent, make_zoo

# Takes the words of fpg-bench train; "trains" a seed that a file of its number does not hold up.
STAND_IN = """
import json, os, sys, time
from pathlib import Path
sys.path.insert(0, {root!r})
from tests.zoo.making import evaluations, make_agent
from fpg_bench.zoo.zoo import load_zoo
here, out, seed = Path({here!r}), Path(sys.argv[-1]), sys.argv[sys.argv.index("--seed") + 1]
out.mkdir(parents=True, exist_ok=True)
(out / "run.json").write_text('{{"finished": false}}')
with (here / "begun").open("a") as file:
    file.write(seed + "\\n")
if (here / f"break_{{seed}}").exists():
    sys.exit("fpg-bench: out of luck")
try:
    while (here / f"hold_{{seed}}").exists():
        time.sleep(0.02)
except KeyboardInterrupt:
    (out / "saved").touch()
    sys.exit(130)
member = [m for m in load_zoo(here).members() if m.algorithm == sys.argv[2] and m.seed == int(seed)][0]
if not (out / "agent").exists():
    make_agent(member, out / "agent")
(out / "evaluations.jsonl").write_text(evaluations())
(out / "run.json").write_text('{{"finished": true}}')
"""
ROOT = os.getcwd()


@pytest.fixture
def zoo(tmp_path, monkeypatch):
    stand_in = tmp_path / "stand_in.py"
    stand_in.write_text(STAND_IN.format(root=ROOT, here=str(tmp_path)))
    monkeypatch.setattr(training, "_PROGRAM", (sys.executable, str(stand_in)))
    monkeypatch.setattr(training, "_PAUSE_S", 0.02)
    return make_zoo(tmp_path)


def begun(zoo):
    file = zoo.folder / "begun"
    return file.read_text().split() if file.exists() else []


def test_the_command_is_what_one_would_type(zoo, tmp_path):
    words = command(zoo.members()[1], tmp_path / "runs")
    start = "train ppo FPG/AllyVsScripted-v0 --seed 1 --steps 2000 --path pursuit,circle --field"
    assert " ".join(words).startswith(start)
    assert words[-3:] == ["--resume", "--out", str(tmp_path / "runs/small/ppo/seed_1")]


@pytest.mark.slow
def test_what_is_missing_is_trained_shipped_and_scored_once(zoo, tmp_path):
    said, runs = [], tmp_path / "runs"
    make_agent(zoo.members()[0])
    assert train_zoo(zoo, runs, only="small/ppo", jobs=2, say=said.append) == []
    assert sorted(begun(zoo)) == ["1", "2"]
    assert [state(member, runs) for member in zoo.members()] == ["shipped"] * 3 + ["missing"] * 3
    assert sum("shipped after" in line for line in said) == 2
    assert {row["training_seed"] for row in curve_file(zoo, zoo.views[0]).read()} == {1, 2}
    scored = [row for row in score_file(zoo, zoo.views[0]).read() if row["entry"] == "ppo"]
    assert {row["training_seed"] for row in scored} == {0, 1, 2}
    train_zoo(zoo, runs, only="small/ppo", say=said.append)
    assert len(begun(zoo)) == 2


@pytest.mark.slow
def test_one_that_fails_does_not_hold_up_the_others(zoo, tmp_path):
    said = []
    (tmp_path / "break_0").touch()
    assert train_zoo(zoo, tmp_path / "runs", only="small/ppo", jobs=1, say=said.append) == [
        "small/ppo/seed_0"
    ]
    assert "small/ppo/seed_0: failed: fpg-bench: out of luck (see " in said[1]
    assert [member.shipped for member in zoo.members("small/ppo")] == [False, True, True]
    (tmp_path / "break_0").unlink()
    assert train_zoo(zoo, tmp_path / "runs", only="small/ppo", say=said.append) == []


@pytest.mark.slow
def test_ctrl_c_stops_the_trainings_and_the_next_call_goes_on(zoo, tmp_path):
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
