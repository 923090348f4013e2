"""Storages, studies and the seeded sampler."""

import optuna
import pytest
import sqlalchemy
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.tuning.study import (
    DATABASE,
    MAX_RETRIES,
    SeededSampler,
    load_study,
    open_storage,
    open_study,
    retry,
)
from tests.products.tuning.fake import fake_task, open_fake, work


def test_a_study_lies_in_a_sqlite_database_in_its_folder(tmp_path):
    folder = tmp_path / "a folder?with#odd%20{letters}"
    work(folder, 3)
    assert [path.name for path in folder.iterdir()] == [DATABASE]
    assert len(open_fake(folder)[1].trials) == 3


def test_a_database_that_is_damaged_is_one_line(tmp_path):
    (tmp_path / DATABASE).write_text("nonsense" * 1000)
    with pytest.raises(UserError, match=rf"{DATABASE}: cannot be opened: file is not a database"):
        open_storage(tmp_path)


def test_a_database_that_fails_later_is_one_line(tmp_path):
    def objective(trial):
        with open_fake(tmp_path)[0].engine.begin() as connection:
            connection.execute(sqlalchemy.text("DROP TABLE trials"))
        return 1.0

    with pytest.raises(UserError, match=r"the database failed \(no such table.*\); once it works, run"):
        work(tmp_path, 1, objective)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nonsense", "expected a URL like postgresql"),
        ("oracle9://host/x", "cannot be opened"),
        ("sqlite:////nowhere/at/all.db", "unable to open database file"),
        ("postgresql+psycopg://me:secret@127.0.0.1:1/x", r"//me:\*\*\*@127.0.0.1:1/x: cannot be opened"),
        ("postgresql+psycopg://me:secret{@127.0.0.1:1/x", "cannot be opened"),
    ],
)
def test_a_storage_that_is_down_at_the_start_is_one_line_without_the_password(tmp_path, url, message):
    with pytest.raises(UserError, match=message) as error:
        open_storage(tmp_path, url)
    assert "secret" not in str(error.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"space": {"x": {"kind": "float", "low": 0, "high": 9}}}, r"made with another space \(x\); cont"),
        ({"n_seeds": 3}, "made with n seeds 2, not 3"),
        ({"game": GameSpec("FPG/OpponentVsScripted-v0")}, r"made with another game \(id\)"),
        ({"hyperparameters": {"x": 4.0}}, r"another hyperparameters \(x\)"),
    ],
)
def test_a_study_of_another_task_is_refused(tmp_path, changes, message):
    storage, _ = open_fake(tmp_path)
    with pytest.raises(UserError, match=message):
        open_study(storage, "fake", fake_task(**changes))


def test_a_study_that_tune_did_not_make_is_refused(tmp_path):
    storage = open_storage(tmp_path)
    optuna.create_study(storage=storage, study_name="mine").add_trial(optuna.create_trial(value=1.0))
    with pytest.raises(UserError, match="was not made by fpg-bench tune"):
        open_study(storage, "mine", fake_task())
    with pytest.raises(UserError, match="was not made by fpg-bench tune"):
        load_study(storage, "mine")


def test_a_study_is_loaded_by_its_name_or_alone(tmp_path):
    storage = open_storage(tmp_path)
    open_fake(tmp_path)
    study, task = load_study(storage, None)
    assert study.study_name == "fake"
    assert task == fake_task()
    with pytest.raises(UserError, match="did you mean 'fake'"):
        load_study(storage, "fak")
    optuna.create_study(storage=storage, study_name="mine")
    with pytest.raises(UserError, match="choose one with --study-name: fake, mine"):
        load_study(storage, None)


def test_present_values_are_queued_once(tmp_path):
    for _ in range(2):
        _, study = open_fake(tmp_path)
    (trial,) = study.trials
    assert trial.state == TrialState.WAITING
    assert trial.system_attrs["fixed_params"] == {"x": 5.0}


def draw(interrupted=()):
    """Return the values of ten trials, of which some are interrupted once, after suggesting or before."""
    study = optuna.create_study(direction="maximize", sampler=SeededSampler())
    study.enqueue_trial({"x": 0.25})
    drawn = []
    while len(drawn) < 10:
        trial = study.ask()
        is_interrupted = trial.number in interrupted
        if not is_interrupted or trial.number % 2:
            x, y = trial.suggest_float("x", 0, 1), trial.suggest_float("y", 1, 9)
        if is_interrupted:
            study.tell(trial, state=TrialState.FAIL)
            retry(study, study.get_trials()[trial.number])
        else:
            drawn.append((x, y))
            study.tell(trial, x - y)
    return drawn


@pytest.mark.parametrize("interrupted", [(3,), (0, 1), (4, 5, 9)])
def test_an_interrupted_study_draws_the_same_values(interrupted):
    assert draw(interrupted) == draw()


def test_a_closed_study_continues_its_sequence(tmp_path):
    at_once = work(tmp_path / "at once", 14)
    for n_trials in (3, 11, 14):
        in_parts = work(tmp_path / "in parts", n_trials)
    assert [trial.params for trial in in_parts.trials] == [trial.params for trial in at_once.trials]
    assert len({trial.params["x"] for trial in at_once.trials}) == 14


@pytest.mark.filterwarnings("ignore:Heartbeat of storage")
def test_a_trial_that_takes_its_worker_with_it_is_given_up(tmp_path):
    storage, study = open_fake(tmp_path)
    callback = storage.get_heartbeat_stale_trial_callback()
    for _ in range(1 + MAX_RETRIES):
        trial = study.ask()
        assert trial.suggest_float("x", 0, 10) == 5.0
        study.tell(trial, state=TrialState.FAIL)
        callback(study, study.get_trials()[trial.number])
    assert study.get_trials(states=(TrialState.WAITING,)) == []


def test_a_study_of_an_older_format_is_refused_in_one_line(tmp_path):
    storage, study = open_fake(tmp_path)
    before = fake_task().model_dump(mode="json")
    before |= {"env_id": before.pop("game")["id"], "options": {}}
    study.set_user_attr("task", before)
    with pytest.raises(UserError, match=r"not made by .* of this version; choose another"):
        open_study(storage, "fake", fake_task())
    with pytest.raises(UserError, match="was made by another version of fpg-bench, so search anew: "):
        load_study(storage, "fake")
