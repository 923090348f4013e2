"""The life cycle of a run in Python."""

from __future__ import annotations

import json

import pytest

from fpg_bench import Run, UserError
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.training import train as training
from tests.training.tiny import run_config, settings


def small(**options):
    return run_config("ppo", hyperparams=settings("ppo"), path=["triangle", "circle"], seed=3, **options)


def test_a_stopped_run_goes_on_from_its_folder_alone(tmp_path, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    begun = Run(tmp_path / "run", small())
    with monkeypatch.context() as broken:
        broken.setattr(training._Run, "finish", stopped)
        with pytest.raises(KeyboardInterrupt):
            begun.train(evaluations=0, progress=False)
    again = Run(tmp_path / "run")
    assert not again.is_finished
    with pytest.raises(UserError, match="holds no agent; is the run finished"):
        again.export(tmp_path / "mine")
    agent = again.resume(evaluations=0, progress=False)
    assert again.is_finished
    assert again.config.spec == small().spec
    assert again.description.training_steps == 1200
    before = (agent / "agent.json").read_bytes()
    assert Run(tmp_path / "run", small()).train(evaluations=0) == agent  # the same run: not repeated
    assert (agent / "agent.json").read_bytes() == before
    (result,) = again.evaluate(matches=1)
    assert result.entry == "ppo"
    assert again.export(tmp_path / "mine/seed_3") < 1e-4
    with pytest.raises(UserError, match="an agent already"):
        again.export(tmp_path / "mine/seed_3")


def test_a_description_runs_no_code_and_says_what_it_lacks(tmp_path):
    with pytest.raises(UserError, match=r"run\.json: cannot be read"):
        Run(tmp_path)
    about = {"algorithm": "ppo", "side": "ally", "training_seed": 0}
    for changes, message in (
        ({"algorithm": "evil:Class"}, "would run evil:Class"),
        ({"hyperparameters": {"imitate": {"teacher": "evil:Player"}}}, "would run evil:Player"),
        ({"game": None}, "of another program; give its configuration"),
        ({"offline": {"dataset": "x"}}, "on a data set; give its configuration"),
        ({"training_seed": "0"}, "training_seed: expected a whole number, got '0'"),
    ):
        game = {"game": {"id": "FPG/AllyVsScripted-v0"}}
        (tmp_path / "run.json").write_text(json.dumps(about | game | changes))
        with pytest.raises(UserError, match=message):
            Run(tmp_path)
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(UserError, match="lacks algorithm; it is no description"):
        Run(tmp_path)


def test_a_description_of_an_earlier_version_is_read(tmp_path):
    options = {"path": "triangle,circle", "start": "a"}
    old = {"algorithm": "ppo", "id": "FPG/AllyVsScripted-v0", "side": "ally", "training_seed": 2}
    (tmp_path / "run.json").write_text(json.dumps(old | {"options": options, "new": 1}))
    about = RunDescription.read(tmp_path)
    assert about.game.path == ("triangle", "circle")
    assert about.options == {"start": "a"}
    about.write(tmp_path)
    assert json.loads((tmp_path / "run.json").read_text())["new"] == 1
    assert RunDescription.read(tmp_path) == about
