"""A study in a real PostgreSQL, which is killed and comes back in the middle."""

import os

import pytest
import sqlalchemy
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from tests.training.tuning.fake import fake_worker, highest_x
from tests.training.tuning.postgres import Server, programs

pytestmark = [
    pytest.mark.postgres,
    pytest.mark.skipif(
        programs() is None and not os.environ.get("CI"),
        reason="needs the programs of PostgreSQL (Debian: apt-get install postgresql)",
    ),
]


@pytest.fixture(scope="module")
def running():
    server = Server()
    yield server
    server.remove()


@pytest.fixture
def server(running):
    """A server that is up, with nothing in its database."""
    if running.process is None:
        running.start()
    engine = sqlalchemy.create_engine(running.url)
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("DROP SCHEMA public CASCADE"))
        connection.execute(sqlalchemy.text("CREATE SCHEMA public"))
    engine.dispose()
    return running


def read_until(words, *processes):
    """Wait until each of the processes has said something."""
    for process in processes:
        assert any(words in line for line in process.stdout), process.stderr.read()


def test_a_server_that_goes_down_and_comes_back_in_the_middle(server, tmp_path):
    lines = []

    def objective(values, trial, report):
        if trial.number == 2:
            server.kill()
        return highest_x(values, trial, report)

    def say(line):
        lines.append(line)
        if "does not answer" in line:
            server.start()

    worker, study = fake_worker(tmp_path, objective, url=server.url, say=say)
    worker.run(5)
    assert sum("does not answer" in line for line in lines) == 1
    assert [trial.state for trial in study.trials] == [TrialState.COMPLETE] * 5
    assert [t.value for t in study.trials] == pytest.approx([t.params["x"] for t in study.trials], rel=1e-3)
    assert os.listdir(tmp_path) == []


def test_workers_begin_together_and_live_through_a_restart(server, tmp_path, started):
    both = [started(tmp_path, url=server.url, trials=12, seconds=0.4) for _ in range(2)]
    read_until("at work", *both)
    server.kill()
    read_until("does not answer", *both)
    server.start()
    said = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    trials = fake_worker(tmp_path, url=server.url)[1].trials
    complete = [trial for trial in trials if trial.state == TrialState.COMPLETE]
    assert 12 <= len(complete) <= 13
    assert sorted(trial.number for trial in trials) == list(range(len(trials)))


def test_a_server_that_stays_down_ends_the_worker_with_a_line_and_keeps_what_was_finished(server, tmp_path):
    def objective(values, trial, report):
        if trial.number == 2:
            server.kill()
        return highest_x(values, trial, report)

    worker, _ = fake_worker(tmp_path, objective, url=server.url, patience_s=1.5)
    with pytest.raises(UserError, match=r"tuner@127.*does not answer for 1.5 s .*run the same command again"):
        worker.run(5)
    with pytest.raises(UserError, match="cannot be opened: connection failed"):
        fake_worker(tmp_path, url=server.url)
    server.start()
    first, second, third = fake_worker(tmp_path, url=server.url)[1].trials
    assert [first.value, second.value] == pytest.approx([5.0, second.params["x"]], rel=1e-3)
    assert third.state == TrialState.RUNNING  # until its heartbeat is missed


def test_a_machine_that_dies_is_missed_by_its_heartbeat(server, tmp_path, at_work):
    process = at_work(tmp_path, url=server.url, host="elsewhere")
    worker, study = fake_worker(tmp_path, url=server.url)
    process.kill()
    process.wait()
    worker.run(2)  # waits for the three seconds that a heartbeat may be late
    trials = study.trials
    assert [trial.state.name for trial in trials].count("COMPLETE") == 2
    assert trials[0].state == TrialState.FAIL
    (again,) = [trial for trial in trials if trial.user_attrs.get("tries") == 2]
    assert again.params == trials[0].params
    assert again.state == TrialState.COMPLETE


def test_a_machine_that_lives_is_not_missed(server, tmp_path, started):
    process = started(tmp_path, url=server.url, trials=1, seconds=3.5, host="elsewhere")
    read_until("at work", process)
    worker, study = fake_worker(tmp_path, url=server.url)
    worker.run(1)  # longer than a heartbeat may be late
    assert [trial.state for trial in study.trials] == [TrialState.COMPLETE]
    assert study.trials[0].user_attrs["worker"]["host"] == "elsewhere"
