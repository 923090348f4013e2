"""``fpg-bench play`` with a language model, as a user starts it: recorded, stopped, played again."""

import json
import os
import re
import signal
import threading

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.rendering.watching import watch
from tests.products.language_models.fault_server import FaultServer, late, ok, status
from tests.products.language_models.playing import KEY, SHORT, path_text
from tests.programs import fpg, held_elsewhere, python
from tests.working import wait_for

LLM = ("--planner", "llm", "--scenario", "short.yml", "--rounds", "3", "--every", "32")
RECORD = ("--record", "asked.jsonl")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "short.yml").write_text("steps_per_round: 32\n")
    return tmp_path


def environment(server=None):
    known = {name: value for name, value in os.environ.items() if not name.startswith("FPG_LLM_")}
    named = {} if server is None else {"FPG_LLM_BASE_URL": server.url, "FPG_LLM_MODEL": "some-model"}
    return {**known, **named, "FPG_LLM_API_KEY": KEY}


def play(*arguments, folder, server=None):
    ran = fpg("play", *LLM, *arguments, folder=folder, environment=environment(server))
    assert KEY not in ran.stdout + ran.stderr
    return ran


def error_line(ran):
    return ran.stderr.splitlines()[-1]


@pytest.mark.process
def test_a_recorded_match_goes_on_and_is_played_again_without_a_server(folder):
    with FaultServer([ok(path_text()), ok("no idea"), ok(path_text(200)), status(500)]) as server:
        ran = play(*RECORD, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert re.findall(r"^ +plan ([\w-]+)", ran.stdout, re.MULTILINE) == ["ok", "reasked", "fallback-http"]
        assert server.requests[0].headers["authorization"] == f"Bearer {KEY}"
        again = play(*RECORD, folder=folder, server=server)
        assert again.stdout == ran.stdout
        assert len(server.requests) == 6  # the failed one is tried three times
        other = play(*RECORD, "--prompt", "paper", folder=folder, server=server)
        assert other.returncode == 2
        assert "was recorded with other messages" in error_line(other)
    again = play("--transcript", "asked.jsonl", folder=folder)
    assert again.stdout == ran.stdout
    file = folder / "asked.jsonl"
    text = file.read_text()
    assert KEY not in text
    file.write_text(text.replace('\\"x\\": 300', '\\"x\\": 301'))
    changed = play("--transcript", "asked.jsonl", folder=folder)
    assert changed.returncode == 2
    assert "round 1, attempt 1 is changed" in error_line(changed)


@pytest.mark.process
def test_a_wrong_key_ends_it_and_the_right_one_goes_on(folder):
    with FaultServer([status(401)]) as server:
        ran = play(*RECORD, folder=folder, server=server)
        assert ran.returncode == 2
        assert "HTTP 401, the key is refused (FPG_LLM_API_KEY)" in error_line(ran)
        assert "mend the server or the FPG_LLM_ variables" in error_line(ran)
        server.behaviours = [ok(path_text())]
        ran = play(*RECORD, "--calls", 2, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert "plan fallback-budget" in ran.stdout
        ran = play(*RECORD, "--calls", 9, folder=folder, server=server)
        assert "plans without an answer: 1 (budget 1); they stay as they were flown" in error_line(ran)


@pytest.mark.process
def test_ctrl_c_keeps_what_was_answered_and_the_next_run_goes_on(folder):
    code = (
        "import os; open('process', 'w').write(str(os.getpid())); from fpg_bench.cli.main import main; main()"
    )
    with FaultServer([ok(path_text()), late(60, path_text())]) as server:

        def interrupt():
            wait_for(lambda: len(server.requests) == 2, 120)
            os.kill(int((folder / "process").read_text()), signal.SIGINT)  # long before the server answers

        threading.Thread(target=interrupt).start()
        ran = python("-c", code, "play", *LLM, *RECORD, folder=folder, environment=environment(server))
        assert ran.returncode == 130, ran.stderr
        assert ran.stderr.splitlines()[-1] == "fpg-bench: stopped; what was finished is kept"
        server.behaviours = [ok(path_text(x)) for x in range(10)]
        ran = play(*RECORD, folder=folder, server=server)
        assert ran.returncode == 0, ran.stderr
        assert len(server.requests) == 4
    rows = [json.loads(line) for line in (folder / "asked.jsonl").read_text().splitlines()]
    assert [row["round"] for row in rows] == [0, 1, 2]


def test_options_reach_the_model_and_the_file_is_let_go(asks, tmp_path, capsys):
    file = tmp_path / "asked.jsonl"
    with FaultServer([late(30, path_text()), ok(path_text())]) as server:
        asks(server)
        given = {"scenario": SHORT, "planner": "llm-no-history", "rounds": 2}
        watch(**given, llm={"record": file, "server": "vllm", "deadline": 0.2})
        assert "seed" in server.requests[0].body
    assert "plan fallback-timeout" in capsys.readouterr().out
    with held_elsewhere(file):
        pass
    for llm, message in (({"record": file, "transcript": file}, "leave out one"), ({"tokns": 3}, "tokns")):
        with pytest.raises(UserError, match=message):
            watch(**given, llm=llm)
    with pytest.raises(UserError, match="calls: is for the planners llm"):
        watch(scenario=SHORT, planner="circle", llm={"calls": 3})
