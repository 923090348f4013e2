"""The libraries that the package uses send nothing about its users unless these ask for it."""

import json
import os
import subprocess
import sys

import pytest

from fpg_bench.common.extras import NO_TELEMETRY, turn_off_telemetry
from fpg_bench.game.compiling import cache_folder
from fpg_bench.products.sandbox import process

PLAYS = """
import json, os
import numpy as np
import fpg_bench
player = fpg_bench.load_agent("ally-scripted/ppo/seed_0", "ally")
player.predict(np.zeros((1, 15), np.float32))
files = [os.readlink(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")[:-1]]
print(json.dumps([len(os.listdir("/proc/self/task")), [file for file in files if os.path.isfile(file)]]))
"""


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_an_agent_plays_without_threads_and_leaves_nothing_in_the_users_cache(tmp_path):
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": os.pathsep.join(sys.path),
        "HOME": str(tmp_path),
        "NUMBA_CACHE_DIR": str(cache_folder().parents[1]),
        "OPENBLAS_NUM_THREADS": "1",
    }
    output = subprocess.check_output([sys.executable, "-c", PLAYS], env=environment, cwd=tmp_path, text=True)
    assert json.loads(output) == [1, []]
    assert [path for path in tmp_path.rglob("*") if "onnxruntime" in path.name] == []


def test_what_the_user_chose_stays_but_not_in_a_sandbox(monkeypatch):
    monkeypatch.setenv("ORT_DISABLE_TELEMETRY", "0")
    for name in NO_TELEMETRY.keys() - {"ORT_DISABLE_TELEMETRY"}:
        monkeypatch.delenv(name, raising=False)
    turn_off_telemetry()
    assert {name: os.environ[name] for name in NO_TELEMETRY} == NO_TELEMETRY | {"ORT_DISABLE_TELEMETRY": "0"}
    assert process._environment().items() >= NO_TELEMETRY.items()
