"""A process that reads somebody's bytes reaches no file, no network, no other process and no key."""

import json
import os
import socket
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fpg_bench import UserError, load_agent
from fpg_bench.cli.main import app
from fpg_bench.products.leaderboard.playing import OPEN
from fpg_bench.products.leaderboard.verification import verify
from fpg_bench.products.sandbox import client, process
from fpg_bench.products.sandbox.client import PolicyClient, check_policy
from fpg_bench.products.sandbox.isolation import Layer, missing
from fpg_bench.products.sandbox.process import ProcessLimits, Sandbox
from tests.attacks.prisoner import escapes
from tests.players.test_agent import model_bytes
from tests.policies import policy
from tests.products.leaderboard.entering import enter
from tests.products.leaderboard.making import as_policy, write_submission

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the layers are Linux's")


@pytest.fixture
def open_doors(monkeypatch):
    """Things to reach outside: a port, a name and this process' environment."""
    server, named = socket.create_server(("127.0.0.1", 0)), socket.socket(socket.AF_UNIX)
    name = f"fpg-bench-test-{os.getpid()}"
    named.bind(f"\0{name}")
    named.listen()
    doors = {"OPEN_PORT": str(server.getsockname()[1]), "OPEN_NAME": name, "PARENT": str(os.getpid())}
    environment = process._environment
    monkeypatch.setattr(process, "_environment", lambda: environment() | doors)
    with server, named:
        yield doors


def test_nothing_gets_out(open_doors):
    prison = Sandbox("tests.attacks.prisoner", ProcessLimits())
    with prison.within(60):
        (size,) = struct.unpack("<I", prison.receive(4))
        results, passing = json.loads(prison.receive(size))
    prison.close()
    assert results.keys() == escapes(0).keys()
    assert [name for name, result in results.items() if result == "out"] == []
    assert passing == []
    assert process.missing_here() == []


OPEN_WITHOUT_CALLS = {"fork", "listen", "send", "new users", "another name", "leave the root", "connect"}
ALONE = """
import json, os, sys
from fpg_bench.products.sandbox import isolation
from tests.attacks.prisoner import attempted
kept = isolation.{kept}
for name in ("_landlocked", "_calls_refused", "_empty_root"):
    if name != "{kept}":
        setattr(isolation, name, lambda *library: False)
standing = isolation.shut(isolation.Layer(0))
print(json.dumps([int(standing), attempted(int(os.environ["PARENT"]))]))
"""


@pytest.mark.process
@pytest.mark.parametrize(
    ("kept", "layer", "open_still"),
    [("_landlocked", Layer.LANDLOCK, OPEN_WITHOUT_CALLS), ("_calls_refused", Layer.CALLS, set())],
)
def test_each_layer_stands_where_the_others_cannot_be_had(open_doors, kept, layer, open_still):
    done = subprocess.run(
        [sys.executable, "-c", ALONE.format(kept=kept)],
        env=os.environ | open_doors | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    standing, results = json.loads(done.stdout)
    if not standing & layer:
        pytest.skip("this kernel does not have it")
    assert {name for name, result in results.items() if result == "out"} <= open_still


def threads_and_files(pid):
    """The status of each thread of a process, its open files, and those that its memory writes to."""
    folder = Path(f"/proc/{pid}")
    threads = [
        dict(
            line.split(":\t", 1) for line in task.joinpath("status").read_text().splitlines() if ":\t" in line
        )
        for task in folder.joinpath("task").iterdir()
    ]
    files = Counter(os.readlink(file).partition(":")[0] for file in folder.joinpath("fd").iterdir())
    maps = [line.split(maxsplit=5) for line in folder.joinpath("maps").read_text().splitlines()]
    shared = [line[5] for line in maps if line[1].endswith("s") and "w" in line[1]]
    return threads, files, shared


@pytest.mark.parametrize("data", [policy(0), model_bytes(state=3, noise=2)], ids=["plain", "all inputs"])
def test_every_thread_of_a_policy_is_behind_all_walls_and_holds_no_file(data):
    with PolicyClient(as_policy(data)) as playing:
        playing.predict(np.zeros((2, 15), np.float32))
        threads, files, shared = threads_and_files(playing.pid)
        roots = os.listdir(f"/proc/{playing.pid}/root")
        mounts = Path(f"/proc/{playing.pid}/mountinfo").read_text().splitlines()
    for status in threads:
        assert (status["Seccomp"], status["NoNewPrivs"], int(status["CapEff"], 16)) == ("2", "1", 0)
    assert len(threads) == 1
    assert files == {"/dev/null": 3, "socket": 1}
    assert shared == []
    assert roots == []
    assert len(mounts) == 1


THREAD = """
import threading, time
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
"""
LAYERS = """
import os
from fpg_bench.products.sandbox import isolation
isolation.isolate = lambda: (isolation.Layer(0), os.getpid())
isolation.shut = lambda layers: isolation.Layer({})
"""


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """Let the processes of policies begin with some code, as on a machine that lacks what isolates them."""

    def machine_with(code):
        (tmp_path / "site").mkdir()
        (tmp_path / "site" / "sitecustomize.py").write_text(code)
        environment = process._environment

        def changed():
            given = environment()
            return given | {"PYTHONPATH": os.pathsep.join([str(tmp_path / "site"), given["PYTHONPATH"]])}

        monkeypatch.setattr(process, "_environment", changed)
        monkeypatch.setattr(process, "_MISSING", {})
        monkeypatch.setattr(client, "_PROBLEMS", {})

    return machine_with


@pytest.mark.parametrize(
    ("code", "line"),
    [(THREAD, "has 2 threads before it is locked down"), (LAYERS.format(0), "FPG_BENCH_UNPROTECTED=1")],
    ids=["a thread", "no layer"],
)
def test_policies_are_refused_where_nothing_holds_them(machine, tmp_path, code, line):
    agent = write_submission(tmp_path / "entry", seeds=(0,)) / "seed_0"
    player = load_agent(agent)
    machine(code)
    with pytest.raises(UserError, match=line):
        load_agent(agent)
    with pytest.raises(UserError, match=line):
        player.predict(np.zeros((1, 15), np.float32))
    done = CliRunner().invoke(app, ["submit", "check", str(agent.parent)])
    assert line in str(done.exception)


def test_policies_play_without_any_layer_where_the_user_allows_it(machine, monkeypatch, messages):
    machine(LAYERS.format(0))
    monkeypatch.setenv("FPG_BENCH_UNPROTECTED", "1")
    assert check_policy(policy(0)) == []
    assert messages == [
        "this machine cannot keep policies of others from files, the network, other processes"
    ]


def test_what_a_policy_cannot_be_kept_from_is_said_once_wherever_it_plays(machine, messages, tmp_path):
    folder = write_submission(tmp_path / "entry", seeds=(0,))
    machine(LAYERS.format(int(Layer.LANDLOCK)))
    player = load_agent(folder / "seed_0")
    assert messages == ["this machine cannot keep policies of others from the network"]
    player.predict(np.zeros((1, 15), np.float32))
    assert len(messages) == 1


def test_what_could_not_be_had_is_in_the_verdict(board, in_process, monkeypatch):
    monkeypatch.setattr(
        "fpg_bench.products.leaderboard.playing.missing_here", lambda: ["files", "the network"]
    )
    assert missing(Layer(0)) == ["files", "the network", "other processes"]
    assert missing(Layer.LANDLOCK) == ["the network"]
    assert missing(Layer.CALLS) == missing(Layer.NAMESPACES | Layer.EMPTY_ROOT) == []
    enter(board, "ally", "linear", seeds=(0,))
    enter(board, "ally", "wise", script="expert")
    lines = {verdict.name: verdict.line for verdict in verify(board)}
    assert lines["ally/linear"].endswith("; this machine cannot keep a policy from files, the network")
    assert "cannot" not in lines["ally/wise"]
    assert f'"{OPEN}"' not in (board / "results/ally/linear.jsonl").read_text()


FORGETS = """
import os
from pathlib import Path
from fpg_bench.products.sandbox.process import forget_keys
print(*sorted(forget_keys()))
print(dict(os.environ), Path("/proc/self/environ").read_bytes())
"""


@pytest.mark.process
def test_keys_are_forgotten_before_anything_is_played():
    secrets = {"FPG_LLM_API_KEY": "first-secret", "MY_TOKEN": "second-secret", "DB_PASSWORD": "third-secret"}
    env = {"PATH": os.environ["PATH"], "PYTHONPATH": os.pathsep.join(sys.path), "SHOWN": "this", **secrets}
    output = subprocess.check_output([sys.executable, "-c", FORGETS], env=env, text=True)
    names, left = output.splitlines()
    assert set(names.split()) == secrets.keys()
    assert "secret" not in left
    assert left.count("SHOWN") == 2


def test_the_verbs_that_play_forget_them(monkeypatch, tmp_path):
    for words in (["submit", "check", str(tmp_path)], ["leaderboard", "build", "--folder", str(tmp_path)]):
        monkeypatch.setenv("FPG_LLM_API_KEY", "sk-0123456789")
        CliRunner().invoke(app, words)
        assert "FPG_LLM_API_KEY" not in os.environ
