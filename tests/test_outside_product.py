"""A product of another distribution is the equal of a shipped one: it plays, trains, evaluates."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.programs import ROOT
from tests.test_layout import imported
from tests.test_public_floor import PUBLIC_FLOOR


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The command line where the distribution ``their-windy`` is installed, in a folder of its own."""
    home = tmp_path_factory.mktemp("windy")
    shutil.copytree(ROOT / "tests/windy", home / "site/windy", ignore=shutil.ignore_patterns("__pycache__"))
    about = home / "site/their_windy-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their-windy\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[fpg_bench.products]\nwindy = windy\n")
    paths = os.pathsep.join([str(ROOT), str(home / "site")])
    own = os.environ | {"PYTHONPATH": paths}

    def run(*words, status=0):
        command = [sys.executable, "-m", "fpg_bench", *map(str, words)]
        ran = subprocess.run(command, cwd=home, env=own, capture_output=True, text=True)
        assert ran.returncode == status, ran.stdout + ran.stderr
        assert "left out" not in ran.stderr
        return ran.stdout + ran.stderr

    run.home = home
    return run


def test_it_stands_on_the_public_floor_alone():
    source = (ROOT / "tests/windy/parts.py").read_text()
    assert imported(source) <= PUBLIC_FLOOR


@pytest.mark.process
def test_its_player_algorithm_game_and_verb_play_train_and_evaluate(run):
    assert run("shout", "--word", "hello").strip() == "HELLO"
    assert "shy" in run("players")
    assert "--gain-db" in run("train", "--help-all")
    assert "a loud round:" in run("play", "--id", "Windy/loud_v0", "--ally", "shy", "--opponent", "tone")
    game = ("Windy/loud_v0", "--gain-db", 6)
    run("train", "loud-ppo", *game, "--steps", 256, "--n-evals", 1, "--out", "run")
    card = json.loads((run.home / "run/agent/agent.json").read_text())
    assert card["algorithm"] == "loud-ppo"
    assert card["game"] == {"id": "Windy/loud_v0", "gain_db": 6}
    text = run("evaluate", "run/agent", "shy", "expert", "--suite", "windy-loud-v1", "--out", "results")
    assert {"loud-ppo", "shy", "expert"} <= set(text.split())
    louder = run.home / "louder.yml"
    louder.write_text(
        (ROOT / "tests/windy/suites/windy-loud-v1.yml").read_text().replace("gain_db: 6", "gain_db: 60")
    )
    run("evaluate", "expert", "--suite", louder, "--out", "louder")
    returns = [
        json.loads(line)["returns"]
        for folder in ("results", "louder")
        for line in (run.home / folder / "records.jsonl").read_text().splitlines()
        if '"expert"' in line
    ]
    assert len(returns) == 4
    assert returns[:2] != returns[2:]  # the option decides what is played
    unknown = run("train", "loud-ppo", "FPG/AllyVsScripted-v0", "--gain-db", 6, "--out", "no", status=2)
    assert "gain_db" in unknown


@pytest.mark.process
def test_its_search_space_is_found(run):
    code = (
        "from fpg_bench.products.tuning.space import load_space\n"
        "print(load_space('loud-ppo')['gamma'].choices)"
    )
    paths = os.pathsep.join([str(ROOT), str(run.home / "site")])
    found = subprocess.check_output([sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": paths})
    assert found.strip() == b"[0.9, 0.95]"
