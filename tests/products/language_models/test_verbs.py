"""``fpg-bench plan run``, and ``replay``, each as a user starts it."""

import json
import os
import signal
import threading

import pytest

from tests.products.language_models.fault_server import FaultServer, late, ok, status
from tests.programs import fpg, python
from tests.working import wait_for

pytestmark = pytest.mark.process

KEY = "sk-not-to-be-seen-7741"
SHORT = "steps_per_round: 32\n"
LLM = ("--planner", "llm", "--scenario", "short.yml", "--rounds", "3", "--out", "out")


def path_text(x=100):
    return json.dumps({"waypoints": [{"x": x, "y": 700, "z": 300}] * 16})


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "short.yml").write_text(SHORT)
    return tmp_path


def environment(server=None):
    known = {name: value for name, value in os.environ.items() if not name.startswith("FPG_LLM_")}
    named = {} if server is None else {"FPG_LLM_BASE_URL": server.url, "FPG_LLM_MODEL": "some-model"}
    return {**known, **named, "FPG_LLM_API_KEY": KEY}


def plan(*arguments, folder, server=None):
    ran = fpg("plan", *arguments, folder=folder, environment=environment(server))
    assert KEY not in ran.stdout + ran.stderr
    return ran


def error_line(ran):
    (line,) = [line for line in ran.stderr.splitlines() if not line.startswith("fpg_bench: compiling")]
    return line


def lines(file):
    return [json.loads(line) for line in file.read_text().splitlines()]


def test_run_shows_keeps_and_draws_a_match_and_replay_repeats_it(folder):
    arguments = ("run", "--planner", "circle", "--ally", "idle", "--scenario", "short.yml", "--seed", 4)
    ran = plan(*arguments, "--rounds", 3, folder=folder)
    assert ran.returncode == 0, ran.stderr
    out = folder / "runs" / "plan" / "circle-idle-4"
    cells = [line.split()[:7] for line in ran.stdout.splitlines()]
    for row in lines(out / "match.jsonl")[1:]:
        reward = f"{row['opponent_return'] / 32:+.2f}"
        assert f"round {row['round']}: {reward} per step, ok" in ran.stdout
        shares = [f"{100 * row[key] / 32:.1f}" for key in ("near", "jammed")]
        assert [str(row["round"]), reward, *shares, "ok", "circle", "-"] in cells
    assert (out / "paths.png").read_bytes().startswith(b"\x89PNG")
    again = plan("replay", "runs/plan/circle-idle-4/match.jsonl", folder=folder)
    assert again.returncode == 0, again.stderr
    assert again.stdout.splitlines()[-1] == "identical: 3 rounds of runs/plan/circle-idle-4/match.jsonl"
    tables = [each.stdout.partition("circle against idle")[2].split()[:40] for each in (ran, again)]
    assert tables[0] == tables[1] != []


def test_a_language_models_match_goes_on_and_is_repeated_without_it(folder):
    with FaultServer([ok(path_text()), ok("no idea"), ok(path_text(200)), status(500)]) as server:
        ran = plan("run", *LLM, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert "2 of 3 valid" in ran.stdout
        assert server.requests[0].headers["authorization"] == f"Bearer {KEY}"
        again = plan("run", *LLM, folder=folder, server=server)
        assert again.stdout == ran.stdout
        assert len(server.requests) == 6  # the failed one is tried three times
        ran = plan("run", *LLM, "--prompt", "paper", folder=folder, server=server)
        assert ran.returncode == 2
        assert "llm.prompt.name is 'standard' in the file, 'paper' now" in error_line(ran)
    ran = plan("replay", "out/match.jsonl", folder=folder)
    assert ran.returncode == 0, ran.stderr
    assert "fallback-http" in ran.stdout
    file = folder / "out" / "match.jsonl"
    assert all(KEY.encode() not in path.read_bytes() for path in folder.rglob("*") if path.is_file())
    text = file.read_text()
    assert text.count('\\"x\\": 200') == 32  # the reply and the raw body
    file.write_text(text.replace('\\"x\\": 200', '\\"x\\": 201'))
    ran = plan("replay", "out/match.jsonl", folder=folder)
    assert ran.returncode == 2
    assert "round 1, attempt 1 is changed" in error_line(ran)


def test_a_wrong_key_ends_it_and_the_right_one_goes_on(folder):
    with FaultServer([status(401)]) as server:
        ran = plan("run", *LLM, folder=folder, server=server)
        assert ran.returncode == 2
        assert "HTTP 401, the key is refused (FPG_LLM_API_KEY)" in error_line(ran)
        assert "mend the server or the FPG_LLM_ variables" in error_line(ran)
        server.behaviours = [ok(path_text())]
        ran = plan("run", *LLM, "--calls", 2, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert "2 of 3 valid" in ran.stdout
        ran = plan("run", *LLM, "--calls", 9, folder=folder, server=server)
        assert "2 of 3 valid" in ran.stdout
        assert "plans without an answer: 1 (budget 1); they stay as they were flown" in error_line(ran)


def test_options_of_the_language_model_reach_it(folder):
    with FaultServer([ok(path_text())]) as server:
        arguments = ("--control", "no-history", "--server", "vllm", "--calls", "2", "--out", "other.jsonl")
        ran = plan("run", *LLM[:-2], *arguments, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert len(server.requests) == 2
        assert "seed" in server.requests[0].body
    assert "llm-no-history against expert" in ran.stdout
    assert "fallback-budget" in ran.stdout
    assert lines(folder / "other.jsonl")[0]["llm"]["server"] == "vllm"
    assert (folder / "other.png").exists()
    with FaultServer([late(30, path_text())]) as server:
        arguments = ("--deadline", "0.2", "--seconds", "0.2", "--out", "late")
        ran = plan("run", *LLM[:-2], *arguments, folder=folder, server=server)
    assert ran.returncode == 2
    assert "fallback-timeout" in ran.stdout


def test_a_match_without_a_valid_plan_has_no_score(folder):
    problem = "expected 16 points, got 8"
    with FaultServer([ok(json.dumps({"waypoints": [{"x": 1, "y": 2, "z": 3}] * 8}))]) as server:
        ran = plan("run", *LLM, folder=folder, server=server)
    assert ran.returncode == 2
    assert "none of 3 plans is valid, so it has no score (" in error_line(ran)
    assert problem in error_line(ran)
    assert ran.stdout.count(f", circle flown ({problem}") == 3
    (total,) = [line.split() for line in ran.stdout.splitlines() if line.split()[:1] == ["all"]]
    assert total[:7] == ["all", "no", "score", "0", "of", "3", "valid"]


def test_a_match_is_written_among_no_other_files_and_its_figure_by_its_suffix(folder):
    (folder / "taken").mkdir()
    (folder / "taken" / "notes.txt").write_text("mine")
    (folder / "one.svg").write_text("mine")
    match = ("run", "--planner", "circle", "--scenario", "short.yml", "--rounds", "1", "--out")
    for out in ("taken", "one.svg", "short.yml"):
        ran = plan(*match, out, folder=folder)
        assert ran.returncode == 2
        assert f"out: {out} exists and is not a match of plan run; choose another" in error_line(ran)
    assert {path.name for path in folder.rglob("*")} == {"short.yml", "taken", "notes.txt", "one.svg"}
    for out, start in (("two.svg", b"<?xml"), ("two.pdf", b"%PDF")):
        ran = plan(*match, out, folder=folder)
        assert ran.returncode == 0, ran.stderr
        assert (folder / out).read_bytes().startswith(start)
        assert (folder / "two.jsonl").exists()


def test_ctrl_c_keeps_what_was_finished_and_the_next_run_goes_on(folder):
    code = (
        "import os; open('process', 'w').write(str(os.getpid())); from fpg_bench.cli.main import main; main()"
    )
    with FaultServer([ok(path_text()), late(60, path_text())]) as server:

        def interrupt():
            wait_for(lambda: len(server.requests) == 2, 120)
            os.kill(int((folder / "process").read_text()), signal.SIGINT)  # long before the server answers

        threading.Thread(target=interrupt).start()
        ran = python("-c", code, "plan", "run", *LLM, folder=folder, environment=environment(server))
        assert ran.returncode == 130, ran.stderr
        assert ran.stderr.splitlines()[-1] == "fpg-bench: stopped; what was finished is kept"
        assert [row["kind"] for row in lines(folder / "out" / "match.jsonl")] == ["run", "attempt", "round"]
        server.behaviours = [ok(path_text(x)) for x in range(10)]
        ran = plan("run", *LLM, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert len(server.requests) == 4
    kinds = [row["kind"] for row in lines(folder / "out" / "match.jsonl")]
    assert kinds == ["run"] + ["attempt", "round"] * 3
