"""Stopped and killed verbs say what they kept, leave nothing behind, and go on or end in one line."""

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from fpg_bench.cli import main as cli
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.products.leaderboard import crossplay, verification
from fpg_bench.products.leaderboard.folders import at_work, crossplay_file, work_folder
from fpg_bench.products.leaderboard.verification import verify
from fpg_bench.training.checkpoint import load_checkpoint
from tests.products.leaderboard.entering import bad_pairs, enter
from tests.working import fail

STOPS = """
import os, signal, sys
from fpg_bench.cli import main as cli
def app(words, prog_name, standalone_mode):
    try:
        os.kill(os.getpid(), signal.{name})
        signal.pause()
    except KeyboardInterrupt:
        raise {error}("numpy.core.multiarray failed to import")
signal.signal(signal.SIGINT, signal.default_int_handler)
cli.app = app
cli.main()
"""
WRITES = """
import os, signal, sys
from pathlib import Path
from fpg_bench.common import files
files.os.replace = lambda *names: os.kill(os.getpid(), signal.SIGKILL)
files.write_whole(Path(sys.argv[1]), "half")
"""


def python(code, *words, **how):
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen([sys.executable, "-c", code, *map(str, words)], env=env, text=True, **how)


@pytest.mark.process
@pytest.mark.parametrize(
    ("name", "error", "status"),
    [
        ("SIGTERM", "KeyboardInterrupt", 143),
        ("SIGINT", "KeyboardInterrupt", 130),
        ("SIGINT", "ImportError", 130),
    ],
)
def test_a_stopped_command_says_what_is_kept(name, error, status):
    stopped = python(STOPS.format(name=name, error=error), stderr=subprocess.PIPE)
    _, message = stopped.communicate(timeout=60)
    assert (message, stopped.returncode) == ("fpg-bench: stopped; what was finished is kept\n", status)


def test_no_alarm_is_left_where_nothing_is_left_to_stop(monkeypatch):
    swallowed = SimpleNamespace(exc_type=KeyboardInterrupt)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)

    def app(words, prog_name, standalone_mode):
        sys.unraisablehook(swallowed)
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0

    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit):
        cli.main()
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0
    sys.unraisablehook(swallowed)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


@pytest.mark.parametrize(("error", "traces"), [(OSError(errno.ENOSPC, "full"), 0), (ValueError("a bug"), 1)])
def test_an_error_of_files_in_a_thread_is_left_to_who_waits_for_it(error, traces, monkeypatch, capsys):
    def app(words, prog_name, standalone_mode):
        thread = threading.Thread(target=partial(fail, error))
        thread.start()
        thread.join()
        raise error

    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capsys.readouterr().err
    assert (end.value.code, said.count("Traceback"), said.count("fpg-bench: ")) == (1, traces, 1)


@pytest.mark.process
def test_what_is_killed_while_it_writes_leaves_nothing_for_long(tmp_path):
    file = tmp_path / "agent" / "agent.json"
    write_whole(file, "whole")
    killed = python(WRITES, file)
    assert killed.wait(timeout=60) == -signal.SIGKILL
    assert file.read_text() == "whole"
    assert len(os.listdir(file.parent)) == 2
    write_whole(file, "next")
    assert os.listdir(file.parent) == ["agent.json"]
    assert file.read_text() == "next"


def test_a_full_disk_names_the_file_and_keeps_the_one_before(tmp_path, monkeypatch):
    file = tmp_path / "file"
    write_whole(file, "whole")

    def full(*names):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match=f"No space left on device: '{file}'"):
        write_whole(file, "next")
    assert (os.listdir(tmp_path), file.read_text()) == (["file"], "whole")


def test_a_full_disk_names_the_file_of_rows():
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        RowFile(Path("/dev/full")).append([{"return": 1.0}])


@pytest.mark.parametrize(
    "words", ["train ppo FPG/AllyVsScripted-v0", "double-oracle", "reproduce yang-2026 fig7"]
)
def test_a_read_only_folder_is_one_line_before_anything_begins(words, tmp_path, monkeypatch, capsys):
    real = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path and real(path, mode))
    monkeypatch.setattr(sys, "argv", ["fpg-bench", *words.split(), "--out", str(tmp_path / "run" / "ppo")])
    with pytest.raises(SystemExit) as end:
        cli.main()
    line = f"fpg-bench: out: {tmp_path} cannot be written to; make it writable, or name another\n"
    assert (end.value.code, capsys.readouterr().err) == (2, line)


@pytest.mark.parametrize(
    "words",
    [
        "play --out {}/round.html",
        "table results --out {}/table.png",
        "curves run --out {}/curves.svg",
        "play --out {}/match.png",
        "tune export study {}/mine.yml",
    ],
)
def test_a_file_in_a_folder_that_is_not_there_is_refused_by_name_and_nothing_is_made(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    for folder, problem in (("slip/here", "there is no folder"), ("file", "there is no folder")):
        Path("file").touch()
        monkeypatch.setattr(sys, "argv", ["fpg-bench", *words.format(folder).split()])
        with pytest.raises(SystemExit) as end:
            cli.main()
        (line,) = capsys.readouterr().err.splitlines()
        assert end.value.code == 2
        assert f"{problem} {tmp_path / folder}; make it first, or name another" in line
    assert os.listdir(tmp_path) == ["file"]


def test_a_result_that_cannot_be_written_is_kept_where_it_was_played(board, in_process, monkeypatch):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "pupil", seeds=(0,))

    def refused(path, result):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    with monkeypatch.context() as somebody:
        somebody.setattr(verification, "write_result", refused)
        lines = [verdict.line for verdict in verify(board)]
    assert all(line.endswith("Permission denied; what was played is kept, run it again") for line in lines)
    monkeypatch.setattr(verification, "fill", lambda *part: pytest.fail("is played again"))
    assert [verdict.is_good for verdict in verify(board)] == [True, True]
    assert not [path for path in work_folder(board).rglob("*") if path.is_file() and path.name != "at-work"]


def test_pairs_that_cannot_be_written_are_kept_where_they_were_played(board, in_process, monkeypatch):
    enter(board, "ally", "wise", script="expert")
    enter(board, "opponent", "tone", script="tone")
    verify(board)

    def full(path, content):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as disk:
        disk.setattr("fpg_bench.common.rows.write_whole", full)
        with pytest.raises(OSError, match="No space left"):
            bad_pairs(board)
    monkeypatch.setattr(crossplay, "play_pair", lambda *pair: pytest.fail("is played again"))
    assert bad_pairs(board) == {}
    assert len(crossplay_file(board).read_text().splitlines()) == 1
    assert not (work_folder(board) / "crossplay").exists()


# Root may read and write everything, unless it gives up this right.
AS_OTHERS = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.geteuid() == 0 else []


@pytest.mark.process
@pytest.mark.skipif(bool(AS_OTHERS) and not shutil.which("setpriv"), reason="needs setpriv")
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("evaluate expert --matches 1 --out results", "results cannot be written to"),
        ("evaluate expert --matches 1 --out new", "shared cannot be written to"),
        ("evaluate expert --suite hidden.yml --out {own}/new", "hidden.yml"),
        ("table results", "results/table.md"),
        ("play --out round.html", "round.html"),
        ("play --out paths.svg", "paths.svg"),
        ("leaderboard init new", "new"),
        ("dataset check hidden", "hidden"),
        ("curves results", "curves.svg"),
    ],
)
def test_files_of_another_user_are_one_line_that_names_them(words, named, tmp_path):
    shared, own = tmp_path / "shared", tmp_path / "own"
    for folder in (own, shared / "hidden"):
        folder.mkdir(parents=True)
    evaluate(["idle"], "ally-v2", shared / "results", matches=1)
    (shared / "hidden.yml").touch()
    for path in (shared / "hidden", shared / "hidden.yml"):
        path.chmod(0)
    for path in (shared / "results/records.jsonl", shared / "results", shared):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = [*AS_OTHERS, sys.executable, "-m", "fpg_bench", *words.format(own=own).split()]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    done = subprocess.run(code, cwd=shared, env=env, text=True, capture_output=True, timeout=300)
    for path in (shared, shared / "results"):
        path.chmod(0o755)  # to be removed
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("fpg-bench: ")]
    assert done.returncode in (1, 2)
    assert named in line.replace("'", "")
    assert re.search("ermission denied|not readable|cannot be written", line), line


def test_what_another_process_is_writing_stays(tmp_path):
    file = tmp_path / "file"
    write_whole(file, "whole")
    (begun,) = [f".file.{os.uname().nodename}-{os.getpid()}-abc"]
    (tmp_path / begun).write_text("half")
    write_whole(file, "next")
    assert sorted(os.listdir(tmp_path)) == sorted([begun, "file"])


def test_one_process_may_be_at_work_on_a_board_twice(board, in_process):
    enter(board, "ally", "wise", script="expert")
    with at_work(board), at_work(board):
        assert verify(board)[0].is_good


@pytest.mark.parametrize("text", ["{}", '{"seconds": null}', "[]", ""])
def test_a_checkpoint_that_says_nothing_is_one_line(tmp_path, text):
    (tmp_path / "progress.json").write_text(text)
    with pytest.raises(UserError, match="cannot be read"):
        load_checkpoint(Path(tmp_path), None, 0)
