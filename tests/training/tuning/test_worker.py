import json
import signal

import optuna
import pytest
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import JOURNAL
from tests.training.tuning.fake import fake_worker, highest_x


def states(study):
    return [trial.state.name for trial in study.get_trials(deepcopy=False)]


def test_trials_until_enough_are_finished_and_no_more_on_the_next_call(tmp_path):
    lines = []
    worker, study = fake_worker(tmp_path, say=lines.append)
    worker.run(3)
    assert states(study) == ["COMPLETE"] * 3
    assert study.trials[0].params == {"x": 5.0}  # the present values come first
    assert "trial 0: x 5" in lines
    assert lines[1].startswith("trial 0: score 5.0, 0 s; 1 of 3 finished, best 5.0 (trial 0)")
    worker.run(3)
    fake_worker(tmp_path)[0].run(2)
    assert len(study.trials) == 3


def test_a_study_that_was_closed_goes_on_as_one_that_was_not(tmp_path):
    whole, study = fake_worker(tmp_path / "whole")
    whole.run(14)
    for trials in (3, 11, 14):
        worker, parts = fake_worker(tmp_path / "parts")
        worker.run(trials)
    assert [trial.params for trial in parts.trials] == [trial.params for trial in study.trials]
    assert len({trial.params["x"] for trial in parts.trials}) == 14


@pytest.mark.process
def test_a_killed_workers_trial_is_tried_again_with_its_values(tmp_path, at_work):
    process = at_work(tmp_path)
    lines = []
    worker, study = fake_worker(tmp_path, say=lines.append)
    process.kill()
    process.wait()
    worker.run(2)
    assert "trial 0: its worker has died" in lines
    assert states(study) == ["FAIL", "COMPLETE", "COMPLETE"]
    assert study.trials[1].params == study.trials[0].params
    assert study.trials[1].user_attrs["tries"] == 2


@pytest.mark.process
def test_a_trial_that_takes_its_worker_with_it_is_given_up(tmp_path, at_work):
    for _ in range(claim.MOST_TRIES):
        process = at_work(tmp_path)
        process.kill()
        process.wait()
    worker, study = fake_worker(tmp_path)
    worker.run(2)
    assert states(study) == ["FAIL", "FAIL", "FAIL", "COMPLETE"]
    assert study.trials[3].params != study.trials[0].params


@pytest.mark.process
def test_a_worker_waits_for_the_others_and_takes_over_what_they_leave(tmp_path, at_work, monkeypatch):
    process = at_work(tmp_path, trials=1)
    monkeypatch.setattr("fpg_bench.training.tuning.worker.POLL_S", 0.01)
    worker, study = fake_worker(tmp_path)
    waited = []

    def wait(seconds):
        waited.append(seconds)
        process.kill()
        process.wait()

    monkeypatch.setattr("fpg_bench.training.tuning.worker.time.sleep", wait)
    worker.run(1)
    assert waited
    assert states(study) == ["FAIL", "COMPLETE"]


@pytest.mark.process
def test_another_machines_trial_is_left_alone_until_that_machine_is_said_to_be_lost(tmp_path, at_work):
    at_work(tmp_path, host="elsewhere").kill()
    lines = []
    worker, study = fake_worker(tmp_path, say=lines.append)
    worker.run(2)
    assert states(study) == ["RUNNING", "COMPLETE"]
    assert "--lost elsewhere" in lines[-1]
    fake_worker(tmp_path, lost=["elsewhere"])[0].run(2)
    assert states(study) == ["FAIL", "COMPLETE", "COMPLETE"]


@pytest.mark.process
def test_two_workers_share_a_study(tmp_path, started):
    both = [started(tmp_path, trials=12, seconds=0.1) for _ in range(2)]
    said = [process.communicate(timeout=60) for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    trials = fake_worker(tmp_path)[1].trials
    assert 12 <= len(trials) <= 13
    assert {trial.state for trial in trials} == {TrialState.COMPLETE}
    assert len({trial.user_attrs["worker"]["pid"] for trial in trials}) == 2


@pytest.mark.process
def test_ctrl_c_gives_the_trial_back(tmp_path, at_work):
    process = at_work(tmp_path)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    worker, study = fake_worker(tmp_path)
    assert states(study) == ["FAIL", "WAITING"]
    worker.run(1)
    assert states(study) == ["FAIL", "COMPLETE"]
    assert study.trials[1].params == study.trials[0].params
    assert study.trials[1].user_attrs["tries"] == 1  # nobody's fault


def test_no_worker_is_taken_for_dead_while_it_signs(tmp_path, monkeypatch):
    _, study = fake_worker(tmp_path)
    trial = study.ask()
    signed = []
    monkeypatch.setattr(type(trial), "set_user_attr", lambda _, *words: signed.append(words))
    claim.sign(trial)
    monkeypatch.undo()
    for name, value in signed:
        trial.set_user_attr(name, value)
        assert not claim.is_dead(study.trials[0])
    assert not claim.is_foreign(study.trials[0])


def test_a_trial_that_its_worker_could_not_sign_is_given_up_after_a_while(tmp_path, monkeypatch):
    worker, study = fake_worker(tmp_path)
    trial = study.ask()
    unsigned = study.trials[trial.number]
    assert not claim.is_dead(unsigned)
    monkeypatch.setattr(claim, "_UNSIGNED_S", -1)
    assert claim.is_dead(unsigned)
    worker.run(1)
    assert states(study) == ["FAIL", "COMPLETE"]


@pytest.mark.parametrize(
    "broken", [ValueError("loc is nan"), RuntimeError("out of range"), ZeroDivisionError("by zero")]
)
def test_a_trial_that_fails_by_itself_counts_and_says_why(tmp_path, broken):
    def objective(values, trial, report):
        if trial.number == 1:
            raise broken
        return highest_x(values, trial, report)

    lines = []
    worker, study = fake_worker(tmp_path, objective, say=lines.append)
    worker.run(3)
    assert states(study) == ["COMPLETE", "FAIL", "COMPLETE"]
    assert study.trials[1].user_attrs["error"] == f"{type(broken).__name__}: {broken}"
    assert any(str(broken) in line for line in lines)


def test_a_space_in_which_everything_fails_ends_with_a_line(tmp_path):
    def objective(values, trial, report):
        raise ValueError("no such thing")

    worker, study = fake_worker(tmp_path, objective)
    with pytest.raises(UserError, match=r"5 trials failed one after the other, the last: .*no such thing"):
        worker.run(20)
    assert len(study.trials) == 5


def test_a_users_error_ends_the_worker_and_the_trial(tmp_path):
    def objective(values, trial, report):
        raise UserError("hyper-parameters: unknown key")

    worker, study = fake_worker(tmp_path, objective)
    with pytest.raises(UserError, match="unknown key"):
        worker.run(3)
    assert states(study) == ["FAIL"]


def test_halving_stops_what_lies_behind(tmp_path):
    looked = {}

    def objective(values, trial, report):
        for step in (1, 2, 3):
            looked[trial.number] = step
            report(-trial.number, step)
        return Interval(-trial.number, 0, 0, "rounds")

    halving = optuna.pruners.SuccessiveHalvingPruner(min_resource=2, reduction_factor=2)
    worker, study = fake_worker(tmp_path, objective, pruner=halving)
    worker.run(4)
    assert looked == {0: 3, 1: 2, 2: 2, 3: 2}
    assert states(study) == ["COMPLETE", "PRUNED", "PRUNED", "PRUNED"]


def test_a_trial_tried_again_begins_on_the_lowest_rung(tmp_path):
    halving = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2)
    seen = []

    def objective(values, trial, report):
        seen.append([key for key in study.trials[trial.number].system_attrs if "rung" in key])
        report(1.0, 1)
        if len(seen) == 1:
            raise KeyboardInterrupt
        return Interval(1.0, 0, 2, "training seeds")

    worker, study = fake_worker(tmp_path, objective, pruner=halving)
    with pytest.raises(KeyboardInterrupt):
        worker.run(1)
    worker.run(1)
    assert seen == [[], []]
    assert any("rung" in key for key in study.trials[0].system_attrs)


def test_a_worker_that_was_taken_for_dead_goes_on_with_another_trial(tmp_path):
    lines = []

    def objective(values, trial, report):
        if trial.number == 0:
            fake_worker(tmp_path)[1].tell(0, state=TrialState.FAIL)
        return highest_x(values, trial, report)

    worker, study = fake_worker(tmp_path, objective, say=lines.append)
    worker.run(1)
    assert states(study) == ["FAIL", "COMPLETE"]
    assert any("was taken for dead by another worker" in line for line in lines)


def test_what_a_journal_holds_is_json_lines_without_secrets(tmp_path):
    fake_worker(tmp_path)[0].run(1)
    for line in (tmp_path / JOURNAL).read_text().splitlines():
        assert isinstance(json.loads(line), dict)
