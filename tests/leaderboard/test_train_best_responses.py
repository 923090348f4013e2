"""Best responses to a small board's entries: rows, agents and suites, made once."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import identity, load_suite
from fpg_bench.leaderboard.tracks import TRACKS, TrackSuites
from fpg_bench.leaderboard.verification import verify
from tests.leaderboard.entering import enter

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[2] / "scripts" / "train_best_responses.py"


@pytest.fixture
def script(board, in_process, tmp_path, monkeypatch):
    """The script's main on a board of an ally of two training seeds, an opponent, and scripts."""
    spec = importlib.util.spec_from_file_location("train_best_responses", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "train_best_responses", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "run_jobs", lambda jobs, workers: run(jobs))
    enter(board, "ally", "linear", seeds=(3, 1))
    enter(board, "ally", "wise", script="expert")
    enter(board, "opponent", "flying", seeds=(5,), path="learned")

    def call(*words):
        monkeypatch.setattr(
            sys, "argv", ["train_best_responses.py", "--board", str(board), "--runs", str(tmp_path), *words]
        )
        return module.main()

    return call


def run(jobs):
    """All that is not done yet, in this process."""
    for job in jobs:
        if not job.done():
            print(f"{job.name}: begins")
            job.keep(job.run())
    return {}


def rows_of(board):
    return list(map(json.loads, (board / "results/best_responses.jsonl").read_text().splitlines()))


def test_responses_become_rows_agents_and_suites_and_are_made_once(script, board, small_suites, capsys):
    def begun(*words):
        capsys.readouterr()
        assert script("--recipe", "ppo:400", *words) == 0
        return [line for line in capsys.readouterr().out.splitlines() if "begins" in line]

    both = "ally/linear", "opponent/flying"
    assert begun(*both) == ["ally/linear: begins", "opponent/flying: begins"]
    assert begun("--n-seeds", "2", "ally/linear") == ["ally/linear: begins"]
    assert begun(*both) == []
    assert begun("opponent/flying", "--recipe", "ppo:400:discrete") == ["opponent/flying: begins"]
    *rows, discrete = rows_of(board)
    assert (discrete["slug"], discrete["actions"]) == ("flying", "discrete")
    assert [row["reward"] for row in (*rows, discrete)] == ["zero_sum", "zero_sum", "own", "own"]
    assert [(row["track"], row["slug"], row["steps"], row["training_seed"]) for row in rows] == [
        ("ally", "linear", 400, 0),
        ("ally", "linear", 400, 1),
        ("opponent-learned", "flying", 400, 0),
    ]
    assert all(row["agent"].endswith("seed_1") for row in rows[:2])
    assert all(0 <= row["jammed"] <= 1 for row in rows)
    strongest = min(rows[:2], key=lambda row: row["return"])
    about = json.loads((small_suites / "suites/responses-v2/ally/linear/agent.json").read_text())
    assert about["training_seed"] == strongest["training_seed"]
    suite, public = load_suite("ally-responses-v2"), TrackSuites().public(TRACKS["ally"])
    assert suite == TrackSuites().of(TRACKS["ally"])["responses"]
    (met,) = suite.rivals
    assert (met.name, met.players) == ("response to linear", ("responses-v2/ally/linear",))
    assert (met.scenario.opponent_path, suite.scale) == ("pursuit", public.scale)
    assert len(identity(met.players[0])) == 64
    (other,) = load_suite("opponent-learned-responses-v2").rivals
    assert other.scenario.opponent_path == "learned"
    assert not (small_suites / "suites/opponent-responses-v2.yml").exists()
    (verdict,) = verify(board, ["ally/wise"])  # all meet the strongest
    assert verdict.is_good
    head = json.loads((board / "results/ally/wise.jsonl").read_text().splitlines()[0])
    assert head["summary"]["worst"]["responses"]["rival"] == "response to linear"


def test_what_is_no_recipe_is_told(script):
    for text in ("ppo", "ppo:x", "ppo:400:discrete:more"):
        with pytest.raises(UserError, match=f"recipe '{text}': expected algorithm:steps, as ppo:500000"):
            script("--recipe", text)
