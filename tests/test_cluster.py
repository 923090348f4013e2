"""Lists of jobs on a Ray cluster: two machines on loopback, one of which is lost."""

import errno
import os
import re
import signal
import threading
import time
from functools import partial

import pytest

from fpg_bench.common import parallel
from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Job, Workers, folder_job, run_jobs
from tests import working
from tests.working import begun, wait_for

pytestmark = pytest.mark.ray

if "CI" not in os.environ:
    pytest.importorskip("ray", reason="the extra ray is not installed")

# A lost machine is noticed after a second, not after half a minute.
QUICK = {
    "health_check_initial_delay_ms": 0,
    "health_check_period_ms": 500,
    "health_check_timeout_ms": 500,
    "health_check_failure_threshold": 2,
}


@pytest.fixture(scope="module")
def cluster():
    """A head that runs no jobs, and a machine of one CPU."""
    from ray.cluster_utils import Cluster

    started = Cluster(
        initialize_head=True,
        head_node_args={"num_cpus": 0, "include_dashboard": False, "_system_config": QUICK},
    )
    started.add_node(num_cpus=1)
    yield started
    started.shutdown()


@pytest.fixture
def run(cluster):
    return lambda jobs, n_jobs=2: run_jobs(jobs, Workers(n_jobs, "ray", cluster.address))


def held(folder, name, **options):
    return Job(
        name, partial(working.hold, folder, name), done=(folder / f"finished_{name}").exists, **options
    )


def test_jobs_of_a_lost_machine_run_elsewhere(cluster, run, tmp_path):
    other = cluster.add_node(num_cpus=1)
    kept = []

    def lose():
        wait_for(lambda: len(begun(tmp_path)) == 2)
        cluster.remove_node(other, allow_graceful=False)
        time.sleep(2)  # until its worker has gone, too
        (tmp_path / "go").touch()

    loss = threading.Thread(target=lose)
    loss.start()
    assert run([held(tmp_path, name, keep=kept.append) for name in "abc"]) == {}
    loss.join()
    assert sorted(kept) == ["a", "b", "c"]
    assert len(begun(tmp_path)) == 4  # one of them twice
    assert run([held(tmp_path, name) for name in "abc"]) == {}
    assert len(begun(tmp_path)) == 4


def test_killed_workers_and_failing_jobs(run, tmp_path):
    kept = []
    jobs = [
        Job("wild", partial(working.die, tmp_path, "wild", 1), kept.append),
        Job("user", partial(working.fail, UserError("no such thing"))),
        Job("threads", working.threads, kept.append),
        Job("wilder", partial(working.die, tmp_path, "wilder", 99)),
    ]
    lost = "its worker was lost 3 times (WorkerCrashedError)"
    assert run(jobs, n_jobs=1) == {"user": "no such thing", "wilder": lost}
    assert sorted(map(str, kept)) == ["1", "wild"]
    assert begun(tmp_path) == ["wild", "wild", "wilder", "wilder", "wilder"]


def test_results_of_machines_that_do_not_share_the_folder_are_missed(run, tmp_path):
    jobs = [
        folder_job(name, tmp_path / name, partial(work), (tmp_path / name / "agent").exists)
        for name, work in {"here": partial(working.fill, b"p"), "away": working.fill_elsewhere}.items()
    ]
    assert run(jobs, n_jobs=1) == {
        "away": "its files are not here; the machines of a cluster have to share their folder"
    }


@pytest.mark.parametrize("error", [BrokenPipeError(), OSError(errno.ENOSPC, "full"), ZeroDivisionError()])
def test_whatever_the_driver_meets_ends_the_jobs(run, tmp_path, error):
    def refused(result):
        raise error

    jobs = [Job("quick", partial(working.square, tmp_path, 1), refused)]
    jobs += [held(tmp_path, name) for name in "abcd"]  # which would run for ever
    with pytest.raises(type(error)):
        run(jobs, n_jobs=2)
    assert len(begun(tmp_path)) < len(jobs)
    assert run([Job("next", partial(working.square, tmp_path, 3))]) == {}


def test_a_ray_that_does_not_start_is_one_line(monkeypatch):
    import ray

    def fails(**options):
        raise RuntimeError("Failed to start GCS. Last 0 lines of error files:\n.Please check /tmp/ray")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", fails)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with pytest.raises(UserError, match="Ray on this machine: Failed to start GCS"):
        run_jobs([Job("a", int), Job("b", int)], Workers(2, backend="ray"))


def test_ctrl_c_stops_what_runs_there(run, tmp_path):
    def stop():
        wait_for(lambda: begun(tmp_path) == ["a"])
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            run([held(tmp_path, name) for name in "ab"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "saved_a").exists()
    assert begun(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("address", "message"),
    [("127.0.0.1:1", "no Ray cluster answers at 127.0.0.1:1"), ("somewhere", "expected host:port")],
)
def test_an_address_that_does_not_answer(address, message, monkeypatch):
    monkeypatch.setattr(parallel, "_CONNECT_S", 0.5)
    with pytest.raises(UserError, match=re.escape(message)):
        run_jobs([Job("job", working.threads)], Workers(2, "ray", address))
