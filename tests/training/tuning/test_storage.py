import os

import optuna
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.training.tuning.storage import JOURNAL, Patience, open_storage
from fpg_bench.training.tuning.study import find_study, open_study
from tests.training.tuning.fake import fake_task, fake_worker, highest_x


def opened(folder, url=None):
    return open_storage(folder, url, say=print)


@pytest.mark.parametrize("torn", [b'{"op_code": 5, "wor', b'{"op_code":5}', b"\x00\x00\x00"])
def test_a_journal_whose_last_line_was_cut_off_goes_on(tmp_path, torn):
    fake_worker(tmp_path)[0].run(2)
    journal = tmp_path / JOURNAL
    whole = journal.read_bytes()
    journal.write_bytes(whole + torn)
    worker, study = fake_worker(tmp_path)
    assert len(study.trials) == 2
    worker.run(4)
    assert journal.read_bytes().startswith(whole + b"{")
    assert len(fake_worker(tmp_path)[1].trials) == 4


def test_a_journal_damaged_in_the_middle_is_one_line(tmp_path):
    fake_worker(tmp_path)[0].run(2)
    journal = tmp_path / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([lines[0], b"nonsense\n", *lines[1:]]))
    with pytest.raises(UserError, match=rf"{JOURNAL}: cannot be opened"):
        opened(tmp_path)


def test_a_training_runs_folder_is_no_studys(tmp_path):
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(UserError, match="holds a training run; choose another folder"):
        opened(tmp_path)
    assert not (tmp_path / JOURNAL).exists()


def test_a_folder_that_cannot_be_one(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot be opened: (Not a directory|File exists)"):
        opened(tmp_path / "file")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nonsense", "expected a URL like postgresql"),
        ("oracle9://host/x", "cannot be opened"),
        ("sqlite:////nowhere/at/all.db", "unable to open database file"),
        ("postgresql+psycopg://me:secret@127.0.0.1:1/x", r"//me:\*\*\*@127.0.0.1:1/x: cannot be opened"),
    ],
)
def test_a_storage_that_is_down_at_the_start_is_one_line_without_the_password(tmp_path, url, message):
    with pytest.raises(UserError, match=message) as found:
        opened(tmp_path, url)
    assert "\n" not in str(found.value)
    assert "secret" not in str(found.value)


def test_any_database_will_do(tmp_path):
    url = f"sqlite:///{tmp_path}/study.db"
    worker, _ = fake_worker(tmp_path, url=url)
    worker.run(3)
    assert not (tmp_path / JOURNAL).exists()
    assert len(fake_worker(tmp_path, url=url)[1].trials) == 3


def test_a_study_of_something_else_is_refused(tmp_path):
    fake_worker(tmp_path)
    none = optuna.pruners.NopPruner()
    space = {"x": {"kind": "float", "low": 0.0, "high": 9.0}}
    for changes, message in (
        ({"space": space}, r"made with another search space \(x\); continue it"),
        ({"seeds": 3}, "made with seeds 2, not 3"),
        ({"env_id": "FPG/OpponentVsScripted-v0"}, "made with id FPG/AllyVsScripted-v0, not"),
        ({"hyperparameters": {"x": 4.0}}, r"another hyper-parameters \(x\)"),
    ):
        with pytest.raises(UserError, match=message):
            open_study(opened(tmp_path), "fake", fake_task(**changes), none)
    optuna.create_study(storage=opened(tmp_path).optuna, study_name="mine").ask()
    with pytest.raises(UserError, match="was not made by fpg-bench tune"):
        open_study(opened(tmp_path), "mine", fake_task(), none)


def test_a_study_is_found_by_its_name_or_alone(tmp_path):
    with pytest.raises(UserError, match="holds no study"):
        find_study(opened(tmp_path), None)
    fake_worker(tmp_path)
    study, task = find_study(opened(tmp_path), None)
    assert study.study_name == "fake"
    assert task == fake_task()
    with pytest.raises(UserError, match="did you mean 'fake'"):
        find_study(opened(tmp_path), "fak")
    optuna.create_study(storage=opened(tmp_path).optuna, study_name="mine")
    with pytest.raises(UserError, match="choose one with --name: fake, mine"):
        find_study(opened(tmp_path), None)
    with pytest.raises(UserError, match="not made by this version"):
        find_study(opened(tmp_path), "mine")


def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("fpg_bench.training.tuning.storage.time.monotonic", lambda: now[0])
    pauses = []

    def sleep(seconds):
        pauses.append(seconds)
        now[0] += seconds

    monkeypatch.setattr("fpg_bench.training.tuning.storage.time.sleep", sleep)
    return pauses


def test_patience_waits_longer_and_longer_and_goes_on(monkeypatch):
    pauses, lines = clock(monkeypatch), []
    answers = iter([ConnectionRefusedError(111, "Connection refused")] * 9 + ["here"])

    def call():
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    assert Patience("storage x", 300, lines.append)(call) == "here"
    assert pauses == [0.5, 1, 2, 4, 8, 16, 30, 30, 30]
    assert lines == ["storage x: does not answer (Connection refused); waiting 300 s"]


def test_patience_ends_after_its_time(monkeypatch):
    pauses = clock(monkeypatch)

    def call():
        raise OSError(28, os.strerror(28))

    with pytest.raises(UserError, match=r"for 60 s \(No space left on device\); bring it up"):
        Patience("storage x", 60, lambda line: None)(call)
    assert sum(pauses) == 60


def test_a_journal_that_cannot_grow_for_a_while_loses_nothing(tmp_path, monkeypatch):
    full = [3]
    worker, study = fake_worker(tmp_path)
    backend = study._storage._backend
    append = type(backend).append_logs

    def fails(self, logs):
        if full[0]:
            full[0] -= 1
            raise OSError(28, os.strerror(28))
        append(self, logs)

    def objective(values, trial, report):
        monkeypatch.setattr(type(backend), "append_logs", fails)
        return highest_x(values, trial, report)

    monkeypatch.setattr("fpg_bench.training.tuning.storage.time.sleep", lambda seconds: None)
    worker._objective = objective
    worker.run(1)
    assert not full[0]
    (trial,) = fake_worker(tmp_path)[1].trials
    assert trial.value == 5.0
