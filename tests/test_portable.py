"""Other machines: Windows, macOS, and containers whose user has no home folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import platformdirs
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import _own_temporary_folder, user_cache
from fpg_bench.common.imports import names_object
from fpg_bench.common.output import is_terminal
from fpg_bench.products.offline.make import datasets_root
from fpg_bench.training.run_folder import RunFolder

pytestmark = pytest.mark.process

# Takes away what Windows lacks; subprocess and its like are imported first, as they choose by the platform
WINDOWS = """
import asyncio, joblib, multiprocessing, os, platformdirs, signal, subprocess, sys, tempfile
from joblib.externals import loky
for module in ("fcntl", "resource"):
    sys.modules[module] = None
for name in ("SIGALRM", "setitimer", "pthread_sigmask"):
    delattr(signal, name)
for name in ("fork", "getpgrp", "setpgrp", "getuid", "sched_getaffinity", "getloadavg"):
    delattr(os, name)
"""

MAIN = "from fpg_bench.cli.main import main; main()"


def on_windows(code, folder, *words, before=""):
    command = [sys.executable, "-c", f"{before}\n{WINDOWS}{code}", *words]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment)


def test_the_command_line_evaluates_without_what_windows_lacks(tmp_path):
    words = ("evaluate", "idle", "--suite", "ally-v2", "--matches", "1", "--n-jobs", "2")
    ran = on_windows(MAIN, tmp_path, *words)
    assert ran.returncode == 0, ran.stderr
    assert "several processes need Linux or macOS" in ran.stderr
    assert (tmp_path / "results").is_dir()


TINY = """
FPG/AllyVsScripted-v0: {policy: MlpPolicy, n_timesteps: 16, n_envs: 2, n_steps: 8, batch_size: 16}
"""
SPACE = "{learning_rate: {kind: float, low: 0.0001, high: 0.001, log: true}}"


@pytest.mark.full
@pytest.mark.slow
def test_the_command_line_trains_without_what_windows_lacks(tmp_path):
    (tmp_path / "tiny.yml").write_text(TINY)
    (tmp_path / "space.yml").write_text(SPACE)
    game = "ppo FPG/AllyVsScripted-v0 --hyperparams tiny.yml"

    def run(words):
        before = "import torch._dynamo"  # as it is loaded on Linux
        ran = on_windows(
            "from fpg_bench.cli.main import main; main()", tmp_path, *words.split(), before=before
        )
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    train = f"train {game} --n-evals 1 --out run"
    begun = RunFolder(tmp_path / "run")
    run(train)
    about = begun.read()
    shutil.rmtree(begun.agent)
    about.model_copy(update={"finished": False}).write(begun.path)  # as a run that was killed
    run(f"{train} --resume")
    assert begun.is_finished()
    assert len(begun.evaluations.read()) == 2
    run("export run --out mine")
    run(f"train {game} --n-evals 0 --seeds 0-1 --n-jobs 2 --out seeds")
    assert sorted(path.parent.name for path in tmp_path.glob("seeds/*/agent")) == ["seed_0", "seed_1"]
    run(f"tune run {game} --space space.yml --n-seeds 1 --rounds 1 --n-trials 2 --n-jobs 2 --out study")
    assert not list(tmp_path.rglob("*.lock"))


LOCKED_TWICE = """
from pathlib import Path
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
file = RowFile(Path("rows.jsonl"))
with file.locked():
    file.append([{"a": 1}])
    if len(sys.argv) == 1:
        print(subprocess.run([*sys.orig_argv, "inner"], capture_output=True, text=True).stderr)
with file.locked():
    print(file.read())
"""


def test_files_are_locked_without_fcntl(tmp_path):
    ran = on_windows(LOCKED_TWICE, tmp_path)
    assert "UserError: rows.jsonl: another process is writing there; wait until it ends" in ran.stdout
    assert ran.stdout.endswith("[{'a': 1}]\n"), ran.stderr


def test_a_sandbox_says_that_it_needs_linux(tmp_path):
    code = """
from fpg_bench.products.sandbox.process import ProcessLimits, Sandbox
Sandbox("fpg_bench.products.sandbox.policy", ProcessLimits())
"""
    error = on_windows(code, tmp_path).stderr
    assert "UserError: an agent of others runs in a sandbox, which needs Linux" in error


def test_a_path_with_a_drive_is_no_object():
    assert not names_object(r"C:\runs\agent")
    assert not names_object("d:/runs/agent")
    assert not names_object("idle")
    assert names_object("package.module:Player")
    assert names_object("m:Player")


def homeless(*words, **options):
    raise RuntimeError("Could not determine home directory.")


@pytest.fixture
def no_home(monkeypatch, tmp_path):
    monkeypatch.setattr(platformdirs, "user_cache_path", homeless)
    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)
    _own_temporary_folder.cache_clear()
    yield tmp_path
    _own_temporary_folder.cache_clear()


def test_without_a_home_folder_the_cache_is_a_private_temporary_one_and_said_once(no_home, messages):
    folder = user_cache()
    assert folder == user_cache() == no_home / f"fpg_bench-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert messages == [f"no home folder (set HOME); the cache is {folder}"]
    with pytest.raises(UserError, match="no home folder; set MINARI_DATASETS_PATH"):
        datasets_root()


def test_a_temporary_cache_that_others_may_write_is_not_used(no_home, monkeypatch):
    planted = no_home / f"fpg_bench-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    monkeypatch.setattr("tempfile.mkdtemp", lambda prefix: str(no_home / "own"))
    assert user_cache() == no_home / "own"


def test_a_missing_stream_is_no_terminal():
    assert not is_terminal(None)
    assert not is_terminal(SimpleNamespace(write=print))  # one that somebody put in its place
