"""A study in a real PostgreSQL, which goes down and comes back."""

import os

import pytest
import sqlalchemy
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from tests.products.tuning.fake import highest_x, miss_heartbeats, open_fake, work
from tests.products.tuning.postgres import Server, programs

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
    """A server that is up, with an empty database."""
    if running.process is None:
        running.start()
    engine = sqlalchemy.create_engine(running.url)
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("DROP SCHEMA public CASCADE"))
        connection.execute(sqlalchemy.text("CREATE SCHEMA public"))
    engine.dispose()
    return running


def test_a_server_that_restarts_during_a_trial_is_not_noticed(server, tmp_path):
    def objective(trial):
        value = highest_x(trial)
        if trial.number == 2:
            server.kill()
            server.start()
        return value

    assert [t.state for t in work(tmp_path, 5, objective, url=server.url).trials] == [TrialState.COMPLETE] * 5


def test_a_server_that_goes_down_ends_the_worker_with_a_line_and_finished_trials_are_kept(server, tmp_path):
    def objective(trial):
        if trial.number == 2:
            server.kill()
        return highest_x(trial)

    with pytest.raises(
        UserError, match=r"tuner@127.*the database failed \(.*\); once it works, run the same"
    ):
        work(tmp_path, 5, objective, url=server.url)
    with pytest.raises(UserError, match="cannot be opened: connection failed"):
        open_fake(tmp_path, server.url)
    server.start()
    first, second, third = open_fake(tmp_path, server.url)[1].trials
    assert [first.value, second.value] == pytest.approx([5.0, second.params["x"]], rel=1e-3)
    assert third.state == TrialState.RUNNING
    miss_heartbeats(tmp_path, server.url)
    trials = work(tmp_path, 4, url=server.url).trials
    assert [trial.state.name for trial in trials] == ["COMPLETE", "COMPLETE", "FAIL", "COMPLETE", "COMPLETE"]
