"""Lists of jobs from the command line."""

import json
import os
import signal
import subprocess
import sys

import pytest

from tests.common.working import wait_for
from tests.programs import fpg
from tests.test_cli import TINY

pytestmark = pytest.mark.process

TRAIN = ("train", "ppo", "FPG/AllyVsScripted-v0", "--hyperparams", "tiny.yml", "--evaluations", "0")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "tiny.yml").write_text(TINY)
    return tmp_path


def test_train_and_evaluate(folder):
    found = fpg(*TRAIN, "--seeds", "0-1", "--jobs", 2, "--out", "runs", folder=folder)
    assert found.returncode == 0, found.stderr
    assert "agents: runs/seed_*/agent" in found.stdout
    agents = [f"runs/seed_{seed}/agent" for seed in (0, 1)]
    words = ("evaluate", *agents, "idle", "--matches", 1, "--jobs", 2, "--out", "results")
    found = fpg(*words, folder=folder)
    assert found.returncode == 0, found.stderr
    assert len((folder / "results" / "records.jsonl").read_text().splitlines()) == 30


def test_ctrl_c_saves_all_runs(folder):
    words = [sys.executable, "-m", "fpg_bench.cli", *TRAIN, "--seeds", "0-2", "--out", "runs"]
    process = subprocess.Popen(
        [*words, "--steps", "100000000"],
        cwd=folder,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # a terminal's Ctrl-C comes to the whole group
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    wait_for(lambda: len(list(folder.glob("runs/*/events*"))) == 2, seconds=180)
    os.killpg(process.pid, signal.SIGINT)
    error = process.communicate(timeout=120)[1]
    assert process.returncode == 130, error
    assert error.splitlines()[-1] == "fpg-bench: stopped; what was finished is kept"
    assert len(list(folder.glob("runs/*/checkpoints/*/model.zip"))) == 2
    assert not (folder / "runs" / "seed_2").exists()
    for file in folder.glob("runs/*/run.json"):
        assert json.loads(file.read_text())["finished"] is False


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("--seeds", "0-1", "--address", "10.0.0.1:6379"),
            "address: is a Ray cluster's; say --backend ray, too",
        ),
        (("--seeds", "4-1"), "seeds: each has to be named once, got '4-1'"),
        (("--backend", "ray"), "backend, address: are for a list of runs; name its --seeds"),
    ],
)
def test_bad_words_are_one_line(folder, words, message):
    found = fpg(*TRAIN, "--out", "runs", *words, folder=folder)
    assert found.returncode == 2
    assert found.stderr == f"fpg-bench: {message}\n"
