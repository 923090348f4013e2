"""Workers of a study: how many trials they run, and what becomes of those that are cut off."""

import logging
import re
import signal

import optuna
import pytest
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import StopRequest
from fpg_bench.products.tuning.worker import run_worker
from tests.products.tuning.fake import highest_x, miss_heartbeats, open_fake, work


def states(study):
    return [trial.state.name for trial in study.get_trials(deepcopy=False)]


def test_a_worker_runs_trials_until_enough_are_finished_and_no_more_on_the_next_call(tmp_path, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    study = work(tmp_path, 3)
    assert states(study) == ["COMPLETE"] * 3
    assert study.trials[0].params == {"x": 5.0}  # the present values come first
    assert re.fullmatch(
        r"trial 0: score 5\.0, \d+ s; 1 finished, 3 asked for, best 5\.0 \(trial 0\)", caplog.messages[0]
    )
    work(tmp_path, 3)
    assert len(work(tmp_path, 2).trials) == 3
    assert len(work(tmp_path, 5).trials) == 5


def test_a_trial_that_another_worker_plays_counts_among_those_asked_for(tmp_path):
    _, study = open_fake(tmp_path)
    study.ask()
    assert states(work(tmp_path, 3)) == ["RUNNING", "COMPLETE", "COMPLETE"]


def test_pruned_and_failed_trials_are_marked_and_have_no_score(tmp_path, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")

    def first_seed_alone_looks_best(trial):
        if trial.number == 1:
            trial.report(19.3, 2)
            raise optuna.TrialPruned
        if trial.number == 2:
            trial.set_user_attr("error", "diverged")
            raise optuna.TrialPruned
        return -highest_x(trial)

    study = work(tmp_path, 4, first_seed_alone_looks_best)
    assert study.trials[1].value == 19.3  # as Optuna keeps it
    lines = [re.sub(r", \d+ s;", ";", line) for line in caplog.messages]
    best = "best -5.0 (trial 0)"
    assert lines[1] == f"trial 1: pruned at evaluation 2; 2 finished (1 pruned), 4 asked for, {best}"
    assert lines[2].startswith("trial 2: failed (diverged); 3 finished (1 pruned, 1 failed), 4 asked for")


@pytest.mark.process
def test_a_killed_workers_trial_is_retried_with_its_values(tmp_path, at_work):
    process = at_work(tmp_path)
    process.kill()
    process.wait()
    study = work(tmp_path, 1)
    assert states(study) == ["RUNNING", "COMPLETE"]  # its heartbeat is not late yet
    miss_heartbeats(tmp_path)
    work(tmp_path, 2)
    assert states(study) == ["FAIL", "COMPLETE", "COMPLETE"]
    assert study.trials[2].params == study.trials[0].params == {"x": 5.0}


@pytest.mark.full
@pytest.mark.process
def test_two_workers_share_a_study(tmp_path, start):
    both = [start(tmp_path, n_trials=10, mode="both") for _ in range(2)]
    output = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], output
    assert "at work" in output[0][0]
    assert "at work" in output[1][0]
    trials = open_fake(tmp_path)[1].trials
    assert 10 <= len(trials) <= 11
    assert {trial.state for trial in trials} == {TrialState.COMPLETE}
    assert [trial.number for trial in trials] == list(range(len(trials)))
    assert sum(trial.params["x"] == 5.0 for trial in trials) == 1


@pytest.mark.process
def test_ctrl_c_queues_the_trial_again(tmp_path, at_work):
    process = at_work(tmp_path)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (130, "")
    _, study = open_fake(tmp_path)
    assert states(study) == ["FAIL", "WAITING"]
    work(tmp_path, 1)
    assert states(study) == ["FAIL", "COMPLETE"]
    assert study.trials[1].params == study.trials[0].params


@pytest.mark.process
def test_the_second_ctrl_c_ends_a_worker_that_does_not_stop(tmp_path, at_work):
    process = at_work(tmp_path, mode="deaf")
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
    assert process.returncode in (130, -signal.SIGINT)
    _, study = open_fake(tmp_path)
    assert states(study)[0] in ("FAIL", "RUNNING")
    miss_heartbeats(tmp_path)
    assert len(work(tmp_path, 1).get_trials(states=(TrialState.COMPLETE,))) == 1


def test_a_stop_between_trials_begins_no_other(tmp_path):
    def objective(trial):
        if trial.number == 1:
            signal.raise_signal(signal.SIGINT)
        return highest_x(trial)

    with pytest.raises(KeyboardInterrupt):
        work(tmp_path, 5, objective)
    assert states(open_fake(tmp_path)[1]) == ["COMPLETE", "COMPLETE"]


def test_a_stop_request_restores_the_handlers_and_calls_them():
    called = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: called.append(number))
    try:
        with StopRequest() as stop:
            stop.check()
            signal.raise_signal(signal.SIGTERM)
            assert stop.is_set
            assert called == []
            with pytest.raises(KeyboardInterrupt):
                stop.check()
        signal.raise_signal(signal.SIGTERM)
        assert called == [signal.SIGTERM] * 2
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("error", [UserError("hyper-parameters: unknown key"), TypeError("a bug")])
def test_an_error_ends_the_worker_and_the_trial(tmp_path, error):
    def objective(trial):
        raise error

    with pytest.raises(type(error), match=str(error)):
        work(tmp_path, 3, objective)
    assert states(open_fake(tmp_path)[1]) == ["FAIL"]


def test_a_space_in_which_every_trial_fails_ends_the_worker(tmp_path):
    def objective(trial):
        trial.set_user_attr("error", "no such thing")
        raise optuna.TrialPruned

    with pytest.raises(UserError, match="5 trials in a row failed, the last: no such thing"):
        work(tmp_path, 20, objective)
    assert states(open_fake(tmp_path)[1]) == ["PRUNED"] * 5


def test_a_worker_that_gave_no_heartbeat_for_long_ends_with_a_line(tmp_path):
    def objective(trial):
        open_fake(tmp_path)[1].tell(trial.number, state=TrialState.FAIL)
        return highest_x(trial)

    with pytest.raises(UserError, match="trial 0: gave no heartbeat for long"):
        work(tmp_path, 1, objective)


def test_no_trial_begins_after_the_timeout(tmp_path):
    storage, study = open_fake(tmp_path)
    run_worker(study, storage, lambda check_stop: highest_x, 3, timeout=0)
    assert states(study) == ["WAITING"]
