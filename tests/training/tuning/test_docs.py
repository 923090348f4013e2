"""What the page on tuning says is so."""

import re
from pathlib import Path

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from fpg_bench.cli import app
from fpg_bench.training.tuning.space import load_space
from fpg_bench.training.tuning.storage import JOURNAL, open_storage
from fpg_bench.training.tuning.study import open_study
from tests.training.tuning.fake import fake_task, fake_worker

TEXT = (Path(__file__).parents[3] / "docs" / "tuning.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)


def options(verb):
    (found,) = [c for c in app.registered_commands if c.callback.__name__.replace("_", "-") == verb]
    return {f"--{name.replace('_', '-')}" for name in found.callback.__annotations__}


def test_every_option_that_is_named_is_there():
    known = set.union(*(options(verb) for verb in ("tune", "tune-report", "tune-write")))
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", TEXT)) <= known


def test_every_command_has_its_options():
    commands = [line.split() for _, code in BLOCKS for line in code.splitlines() if "fpg-bench tune" in line]
    assert len(commands) == 4
    for _, verb, *words in commands:
        assert {word for word in words if word.startswith("--")} <= options(verb)


def test_the_example_of_a_space_is_one(tmp_path):
    (code,) = [code for language, code in BLOCKS if language == "yaml"]
    (tmp_path / "my_space.yml").write_text(code)
    assert load_space("ppo", tmp_path / "my_space.yml").ranges["n_epochs"]["kind"] == "int"


def test_the_study_is_optunas_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    storage = open_storage(Path("runs/tune/ppo"), None, say=print)
    none = optuna.pruners.NopPruner()
    study = open_study(storage, "ppo FPG/AllyVsScripted-v0", fake_task(), none)
    trial = study.ask()
    fake_task().ranges().suggest(trial)
    study.tell(trial, 1.0)
    (code,) = [code for language, code in BLOCKS if language == "python"]
    exec(compile(code, "tuning.md", "exec"), {})  # our own page
    assert capsys.readouterr().out == "{'x': 5.0}\n"


@pytest.mark.parametrize("first", ["ours", "theirs"])
def test_other_programs_may_write_to_the_journal_as_well(tmp_path, first):
    worker, study = fake_worker(tmp_path)
    if first == "ours":
        worker.run(1)
    theirs = optuna.load_study(
        study_name="fake", storage=JournalStorage(JournalFileBackend(str(tmp_path / JOURNAL)))
    )
    theirs.set_user_attr("note", "from a dashboard")
    worker.run(2)
    assert study.user_attrs["note"] == "from a dashboard"
    assert len(theirs.trials) == 2
