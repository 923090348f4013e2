"""Lists of jobs on processes of this machine."""

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.jobs import run
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import MOST_TRIES, run_jobs
from tests.common import working
from tests.common.working import begun, wait_for

pytestmark = pytest.mark.process


def held(folder, name):
    return Job(name, partial(working.hold, folder, name), done=(folder / f"finished_{name}").exists)


def test_all_are_run_and_what_they_return_is_kept(tmp_path):
    kept, said = [], []
    jobs = [Job(str(k), partial(working.square, tmp_path, k), kept.append) for k in range(5)]
    assert run_jobs([*jobs, Job("threads", working.threads, kept.append)], say=said.append) == {}
    assert sorted(kept) == [0, 1, 1, 4, 9, 16]  # one of the ones: of torch's threads
    assert begun(tmp_path) == ["0", "1", "2", "3", "4"]
    assert len(said) == 12


def test_a_line_says_what_is_under_way_where_that_takes_long(monkeypatch):
    monkeypatch.setattr(run, "LINE_EVERY_S", 0.0)
    monkeypatch.setattr(run, "_CHECK_S", 0.01)
    said = []
    run_jobs([Job("long", partial(time.sleep, 0.5))], workers=1, say=said.append)
    assert said[0] == "long: begins"
    assert re.fullmatch(r"under way: long for \d s; 0 to come", said[1])
    assert said[-1].startswith("long: done after")


def test_what_needs_no_importable_module_runs_as_well():
    kept = []
    assert run_jobs([Job("here", lambda: os.getpid(), kept.append)], workers=1) == {}
    assert kept != [os.getpid()]


def test_what_is_done_is_not_run(tmp_path):
    said = []
    jobs = [Job(str(k), partial(working.square, tmp_path, k), done=lambda k=k: k < 2) for k in range(3)]
    run_jobs(jobs, say=said.append)
    assert begun(tmp_path) == ["2"]
    run_jobs(jobs[:2], say=said.append)
    assert len(said) == 2


def test_one_that_fails_is_told_of_and_does_not_hold_up_the_others(tmp_path):
    said, kept = [], []
    errors = {
        "user": UserError("no such thing"),
        "bug": ZeroDivisionError("by zero"),
        "disk": OSError(errno.ENOSPC, "No space left on device", "there"),
    }
    jobs = [Job(name, partial(working.fail, error)) for name, error in errors.items()]
    jobs.append(Job("good", partial(working.square, tmp_path, 3), kept.append))
    failed = run_jobs(jobs, say=said.append)
    assert failed == {
        "user": "no such thing",
        "bug": "a bug: ZeroDivisionError: by zero",
        "disk": "there: No space left on device",
    }
    assert kept == [9]
    assert "user: failed: no such thing" in said
    with pytest.raises(UserError, match=r"user: no such thing \(and 2 more failed\)"):
        check_all_done(failed)
    check_all_done({})


def test_a_killed_workers_job_is_tried_again_and_the_others_go_on(tmp_path):
    kept, said = [], []

    def keep(name):
        kept.append(name)
        (tmp_path / "go").touch()

    jobs = [held(tmp_path, "calm"), Job("wild", partial(working.die, tmp_path, "wild", 1), keep)]
    assert run_jobs(jobs, say=said.append) == {}
    assert kept == ["wild"]
    assert begun(tmp_path) == ["calm", "wild", "wild"]
    assert any(line.startswith("wild: its worker was lost") for line in said)


def test_a_job_that_always_takes_its_worker_along_is_given_up(tmp_path):
    kept = []
    jobs = [Job("wild", partial(working.die, tmp_path, "wild", 99))]
    jobs += [Job(str(k), partial(working.square, tmp_path, k), kept.append) for k in range(3)]
    assert run_jobs(jobs, workers=2) == {"wild": f"lost its worker {MOST_TRIES} times"}
    assert begun(tmp_path).count("wild") == MOST_TRIES
    assert sorted(kept) == [0, 1, 4]


def test_a_job_whose_result_was_there_before_its_worker_was_lost_is_not_run_again(tmp_path):
    done = (tmp_path / "begun").exists
    assert run_jobs([Job("wild", partial(working.die, tmp_path, "wild", 99), done=done)], workers=1) == {}
    assert begun(tmp_path) == ["wild"]


def test_ctrl_c_stops_all_and_the_next_call_goes_on(tmp_path):
    kept = []
    late = Job("late", partial(working.finish, tmp_path, "late"), kept.append, done=lambda: bool(kept))
    jobs = [held(tmp_path, "a"), late, held(tmp_path, "b"), held(tmp_path, "c")]

    def stop():
        wait_for(lambda: len(begun(tmp_path)) == 3)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            run_jobs(jobs, workers=3)
    finally:
        signal.signal(signal.SIGINT, before)
    assert {path.name for path in tmp_path.glob("saved_*")} == {"saved_a", "saved_b", "saved_late"}
    assert kept == ["late"]
    (tmp_path / "go").touch()
    assert run_jobs(jobs) == {}
    assert begun(tmp_path) == ["a", "a", "b", "b", "c", "late"]


DRIVER = """
import sys
from pathlib import Path
from tests.common.test_local import held, run_jobs
run_jobs([held(Path(sys.argv[1]), name) for name in "ab"])
"""


def test_a_driver_that_was_killed_leaves_no_worker_behind_and_repeats_nothing(tmp_path):
    words = [sys.executable, "-c", DRIVER, str(tmp_path)]
    (tmp_path / "finished_a").touch()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: begun(tmp_path) == ["b"])
    process.kill()
    process.wait()
    wait_for((tmp_path / "saved_b").exists)
    (tmp_path / "go").touch()
    assert subprocess.run(words, capture_output=True).returncode == 0
    assert begun(tmp_path) == ["b", "b"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"workers": 0}, "jobs: expected a whole number above 0, got 0"),
        ({"backend": "loki"}, "unknown 'loki'; did you mean 'loky'"),
        ({"address": "host:1"}, "say --backend ray, too"),
    ],
)
def test_bad_words(words, message):
    with pytest.raises(UserError, match=message):
        run_jobs([Job("job", working.threads)], **words)
