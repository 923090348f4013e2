"""Lists of jobs on a Ray cluster: two machines on loopback, one of which is lost."""

import os
import re
import signal
import threading
from functools import partial

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.jobs import cluster as clusters
from fpg_bench.jobs import folders
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import Job
from fpg_bench.jobs.run import run_jobs
from tests.common import working
from tests.common.working import begun, wait_for

pytestmark = pytest.mark.ray

if "CI" not in os.environ:
    pytest.importorskip("ray", reason="the extra ray is not installed")

# A lost machine is missed after a second, not after half a minute.
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

    found = Cluster(
        initialize_head=True,
        head_node_args={"num_cpus": 0, "include_dashboard": False, "_system_config": QUICK},
    )
    found.last = found.add_node(num_cpus=1)
    yield found
    found.shutdown()


@pytest.fixture
def run(cluster):
    return partial(run_jobs, backend="ray", address=cluster.address)


def job(folder, name, work=working.hold, **words):
    return Job(name, partial(work, folder, name), done=(folder / f"finished_{name}").exists, **words)


def test_a_machine_lost_for_good_costs_its_own_jobs_a_try_and_nothing_else(cluster, run, tmp_path):
    other = cluster.add_node(num_cpus=1)
    said, kept = [], []

    def say(line):
        said.append(line)
        if "its worker was lost" in line:
            (tmp_path / "go").touch()

    def lose():
        wait_for(lambda: len(begun(tmp_path)) == 2)
        cluster.remove_node(other, allow_graceful=False)

    loss = threading.Thread(target=lose)
    loss.start()
    assert run([job(tmp_path, name, keep=kept.append) for name in "abc"], say=say) == {}
    loss.join()
    assert sorted(kept) == ["a", "b", "c"]
    assert len(begun(tmp_path)) == 4  # one of them twice
    assert sum("its worker was lost" in line for line in said) == 1
    assert run([job(tmp_path, name) for name in "abc"], say=say) == {}
    assert len(begun(tmp_path)) == 4


def test_a_killed_worker_and_a_job_that_fails(run, tmp_path):
    kept = []
    jobs = [
        Job("wild", partial(working.die, tmp_path, "wild", 1), kept.append),
        Job("user", partial(working.fail, UserError("no such thing"))),
        Job("threads", working.threads, kept.append),
    ]
    assert run(jobs, workers=1) == {"user": "no such thing"}
    assert sorted(map(str, kept)) == ["1", "wild"]
    assert begun(tmp_path) == ["wild", "wild"]


def test_files_come_back_from_machines_that_do_not_see_the_folder(run, tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "mark", lambda folder: "of another machine")
    folder = tmp_path / "seed_0"
    fill = folder_job("seed_0", folder, partial(working.fill, b"policy"), (folder / "run.json").exists)
    assert run([fill], workers=1) == {}
    assert (folder / "agent" / "policy").read_bytes() == b"policy"


def test_ctrl_c_stops_what_runs_there(run, tmp_path):
    def stop():
        wait_for(lambda: begun(tmp_path) == ["a"])
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            run([job(tmp_path, name) for name in "ab"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "saved_a").exists()
    assert begun(tmp_path) == ["a"]


def test_when_no_machine_is_left(cluster, run, tmp_path, monkeypatch):  # the last, for good reason
    monkeypatch.setattr(clusters, "_NO_CPU_S", 1)
    monkeypatch.setattr("fpg_bench.jobs.run._CHECK_S", 0.5)

    def lose():
        wait_for(lambda: begun(tmp_path) == ["a"])
        cluster.remove_node(cluster.last, allow_graceful=False)

    threading.Thread(target=lose).start()
    with pytest.raises(UserError, match="no machine with a CPU left"):
        run([job(tmp_path, "a")])


@pytest.mark.parametrize(
    ("address", "message"),
    [("127.0.0.1:1", "no Ray cluster answers at 127.0.0.1:1"), ("somewhere", "expected host:port")],
)
def test_an_address_that_does_not_answer(address, message, monkeypatch):
    monkeypatch.setattr(clusters, "_ANSWER_S", 0.5)
    with pytest.raises(UserError, match=re.escape(message)):
        run_jobs([Job("job", working.threads)], backend="ray", address=address)
