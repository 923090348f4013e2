"""Lists of jobs: on processes of this machine, from Python and from the command line."""

import contextlib
import errno
import json
import os
import re
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import TRIES, Job, check_all_done, folder_job, run_jobs
from tests import working
from tests.programs import python, started
from tests.test_cli import TINY
from tests.working import begun, wait_for

pytestmark = pytest.mark.process

TRAIN = ("train", "ppo", "FPG/AllyVsScripted-v0", "--hyperparams", "tiny.yml", "--n-evals", "0")
LONG = ("--seeds", "0-2", "--n-jobs", "2", "--out", "runs", "--steps", "100000000")
PAGE = (Path(__file__).parents[1] / "docs/guides/cluster.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)


def held(folder, name):
    return Job(name, partial(working.hold, folder, name), done=(folder / f"finished_{name}").exists)


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_run_and_results_are_kept(tmp_path, workers, messages):
    kept = []
    jobs = [Job(str(k), partial(working.square, tmp_path, k), kept.append) for k in range(4)]
    assert run_jobs(jobs, workers) == {}
    assert sorted(kept) == [0, 1, 4, 9]
    assert begun(tmp_path) == ["0", "1", "2", "3"]
    assert messages[0] == f"4 jobs, {workers} at a time"
    assert len(messages) == 5
    assert messages[-1].endswith(": done after 0 s, 0 to come")


def test_workers_have_one_thread_and_need_no_importable_module():
    kept = []
    jobs = [Job("threads", working.threads, kept.append), Job("here", lambda: -os.getpid(), kept.append)]
    assert run_jobs(jobs) == {}
    process, threads = sorted(kept)
    assert (threads, process != -os.getpid()) == (1, True)


def test_finished_jobs_are_not_run(tmp_path, messages):
    jobs = [Job(str(k), partial(working.square, tmp_path, k), done=lambda k=k: k < 2) for k in range(3)]
    run_jobs(jobs)
    assert begun(tmp_path) == ["2"]
    run_jobs(jobs[:2])
    assert messages == ["2: done after 0 s, 0 to come"]


def test_a_failed_job_is_reported_and_does_not_hold_up_the_others(tmp_path, messages):
    kept = []
    errors = {
        "user": UserError("no such thing"),
        "bug": ZeroDivisionError("by zero"),
        "disk": OSError(errno.ENOSPC, "No space left on device", "there"),
    }
    jobs = [Job(name, partial(working.fail, error)) for name, error in errors.items()]
    jobs.append(Job("good", partial(working.square, tmp_path, 3), kept.append))
    failed = run_jobs(jobs)
    line = working.fail.__code__.co_firstlineno + 1
    assert failed == {
        "user": "no such thing",
        "bug": f"ZeroDivisionError: by zero, in {working.__file__}, line {line}",
        "disk": "there: No space left on device",
    }
    assert kept == [9]
    assert "user: failed: no such thing" in messages
    with pytest.raises(UserError, match=r"user: no such thing \(and 2 more failed\)"):
        check_all_done(failed)
    check_all_done({})


def test_jobs_of_a_killed_worker_run_again(tmp_path, messages):
    kept = []
    done = (tmp_path / "finished").exists
    jobs = [
        Job("wild", partial(working.die, tmp_path, "wild", 1), kept.append),
        Job("late", partial(working.square, tmp_path, 3), kept.append, done),
    ]
    assert run_jobs(jobs) == {}
    assert sorted(map(str, kept)) == ["9", "wild"]
    assert begun(tmp_path).count("wild") == 2
    assert "a worker process was lost (killed, or out of memory?)" in messages


def test_a_job_that_always_kills_its_worker_is_given_up(tmp_path):
    jobs = [Job("wild", partial(working.die, tmp_path, "wild", 99))]
    assert run_jobs(jobs, 2) == {"wild": f"a worker process was lost {TRIES} times"}
    assert begun(tmp_path) == ["wild"] * TRIES


def test_a_job_that_finished_before_its_worker_was_lost_is_not_run_again(tmp_path):
    done = (tmp_path / "begun").exists
    assert run_jobs([Job("wild", partial(working.die, tmp_path, "wild", 99), done=done)], 2) == {}
    assert begun(tmp_path) == ["wild"]


def refused(error, result):
    raise error


@pytest.mark.parametrize("error", [BrokenPipeError(), OSError(errno.ENOSPC, "full"), ZeroDivisionError()])
def test_whatever_the_driver_meets_ends_the_jobs(tmp_path, error, recwarn):
    keep = partial(refused, error)
    jobs = [Job(str(number), partial(working.square, tmp_path, number), keep) for number in range(20)]
    with pytest.raises(type(error)):
        run_jobs(jobs, 2)
    assert len(begun(tmp_path)) < len(jobs)
    assert not recwarn.list
    assert run_jobs([Job("next", partial(working.square, tmp_path, 3))] * 2, 2) == {}


def interrupted(jobs, ready):
    """Run jobs on two workers, and interrupt this process as Ctrl-C does once a condition holds."""

    def stop():
        wait_for(ready)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            run_jobs(jobs, 2)
        assert signal.getsignal(signal.SIGINT) == signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_lets_jobs_save_and_the_next_call_resumes(tmp_path):
    kept = []
    quick = Job("quick", partial(working.square, tmp_path, 2), kept.append, done=lambda: bool(kept))
    jobs = [held(tmp_path, "a"), quick, held(tmp_path, "b"), held(tmp_path, "c")]
    interrupted(jobs, lambda: begun(tmp_path) == ["2", "a", "b"] and kept)
    assert {path.name for path in tmp_path.glob("saved_*")} == {"saved_a", "saved_b"}
    assert kept == [4]
    (tmp_path / "go").touch()
    assert run_jobs(jobs) == {}
    assert begun(tmp_path) == ["2", "a", "a", "b", "b", "c"]


def test_ctrl_c_within_a_callback_stops_a_job_and_prints_nothing(tmp_path, capfd):
    jobs = [Job(name, partial(working.hold_in_callback, tmp_path, name)) for name in "ab"]
    interrupted(jobs, lambda: begun(tmp_path) == ["a", "b"])
    assert begun(tmp_path) == ["a", "a", "b", "b"]
    assert "Exception ignored" not in capfd.readouterr().err


def test_an_import_that_ctrl_c_made_fail_is_no_failed_job(tmp_path, messages):
    jobs = [Job(name, partial(working.fail_import, tmp_path, name)) for name in "ab"]
    interrupted(jobs, lambda: begun(tmp_path) == ["a", "b"])
    assert messages == ["2 jobs, 2 at a time"]


DRIVER = """
import sys
from pathlib import Path
from tests.test_parallel import held, run_jobs
run_jobs([held(Path(sys.argv[1]), name) for name in "ab"])
"""


def test_a_killed_driver_leaves_no_worker_behind(tmp_path):
    command = [sys.executable, "-c", DRIVER, str(tmp_path)]
    (tmp_path / "finished_a").touch()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: begun(tmp_path) == ["b"])
    process.kill()
    process.wait()
    wait_for((tmp_path / "saved_b").exists)
    (tmp_path / "go").touch()
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert begun(tmp_path) == ["b", "b"]


def test_a_folder_job_fills_its_folder_if_its_worker_sees_it(tmp_path):
    job = folder_job("job", tmp_path / "out" / "seed_0", partial(working.fill, b"policy"), done=bool)
    assert job.run() is None
    assert (tmp_path / "out" / "seed_0" / "agent" / "policy").read_bytes() == b"policy"
    (tmp_path / "out").rename(tmp_path / "gone")
    with pytest.raises(UserError, match=f"does not see {tmp_path}/out; the machines of a cluster have to"):
        job.run()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "tiny.yml").write_text(TINY)
    return tmp_path


def at_work(folder):
    """The processes that work in a folder."""
    links = Path("/proc").glob("[0-9]*/cwd")
    return [link for link in links if os.path.realpath(link) == str(folder.resolve())]


# A terminal's Ctrl-C reaches the whole group, a SIGTERM the driver alone
@pytest.mark.parametrize(
    ("send", "number", "status"),
    [(os.killpg, signal.SIGINT, 130), pytest.param(os.kill, signal.SIGTERM, 143, marks=pytest.mark.full)],
)
def test_a_stop_saves_all_runs_and_leaves_no_worker(send, number, status, folder):
    process = started(*TRAIN, *LONG, folder=folder, start_new_session=True)
    try:
        wait_for(lambda: len(list(folder.glob("runs/*/events*"))) == 2)
        send(process.pid, number)
        error = process.communicate(timeout=120)[1]
    finally:  # its runs would take days
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == status, error
    assert at_work(folder) == []
    assert "fpg-bench: stopped; what was finished is kept" in error.splitlines()
    assert len(list(folder.glob("runs/*/checkpoints/*/model.zip"))) == 2
    assert not (folder / "runs" / "seed_2").exists()
    for file in folder.glob("runs/*/run.json"):
        assert json.loads(file.read_text())["finished"] is False


def test_shell_scripts_of_the_page_are_valid():
    for language, code in BLOCKS:
        if language == "bash":
            subprocess.run(["bash", "-n"], input=code, text=True, check=True)


def test_the_program_of_the_page_trains_once(tmp_path):
    code = next(code for language, code in BLOCKS if language == "python")
    small = code.replace("2_000_000", "20_000").replace("range(5)", "range(2)")
    small = small.replace("workers=2", "workers=2, evaluations=0")
    for count in (2, 0):
        result = python("-c", small, folder=tmp_path)
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("done after") == count
    assert len(list(tmp_path.glob("runs/ppo/seed_?/agent/policy.onnx"))) == 2
