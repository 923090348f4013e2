"""The life cycle of a run in Python."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from pathlib import Path

import pytest
import yaml

from fpg_bench import GameSpec, Run, UserError
from fpg_bench.cli.main import main
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.training import run_folder
from fpg_bench.training import train as training
from tests.training.tiny import ALLY, run_config, settings, train_tiny

CODE = "stable_baselines3.common.torch_layers:FlattenExtractor"


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


def test_a_run_of_an_older_format_is_refused_in_one_line(tmp_path):
    old = {"algorithm": "ppo", "id": ALLY, "side": "ally", "options": {"path": "triangle,circle"}}
    (tmp_path / "run.json").write_text(json.dumps(old))
    with pytest.raises(UserError, match=r"run\.json: is of an older format; train again in another folder"):
        RunDescription.read(tmp_path)
    with pytest.raises(UserError, match="older format"):
        Run(tmp_path, small()).train(progress=False)
    assert [path.name for path in tmp_path.iterdir() if path.name != "evaluations.jsonl"] == ["run.json"]


def test_further_keys_of_a_description_are_kept(tmp_path):
    RunDescription(algorithm="ppo", game=GameSpec(ALLY), new=1).write(tmp_path)
    about = RunDescription.read(tmp_path)
    about.write(tmp_path)
    assert json.loads((tmp_path / "run.json").read_text())["new"] == 1
    assert RunDescription.read(tmp_path) == about


@pytest.mark.slow
def test_a_recorded_command_makes_the_run_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a folder elsewhere is named without its place
    entry = settings("ppo", learning_rate=1e-5)
    entry["policy_kwargs"] = {"net_arch": [8], "features_extractor_class": CODE}
    (tmp_path / "tiny.yml").write_text(yaml.safe_dump({ALLY: entry}))
    line = f"fpg-bench train ppo {ALLY} --hyperparams tiny.yml --n-evals 0 --path circle,triangle --seed 3"
    line += f" --steps 400 --allow {CODE} --out"
    policies = []
    for out in (tmp_path / "a run", Path("a run")):
        monkeypatch.setattr(sys, "argv", [*shlex.split(line), str(out)])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        about = json.loads((out / "agent" / "agent.json").read_text())
        assert about["command"] == RunDescription.read(out).command == f"{line} 'a run'"
        policies.append(about["policy_sha256"])
        shutil.rmtree(out)
    assert len(set(policies)) == 1


def test_another_suite_for_the_same_run_is_refused(tmp_path):
    train_tiny("ppo", tmp_path / "run", suite="ally-shifted-v2")
    train_tiny("ppo", tmp_path / "run", suite="ally-shifted-v2")
    for options in ({}, {"suite": "ally-v2", "resume": True}):
        with pytest.raises(UserError) as raised:
            train_tiny("ppo", tmp_path / "run", **options)
        assert str(raised.value) == (
            f"{tmp_path / 'run'}: holds this run scored on ally-shifted-v2, not on ally-v2; keep its suite "
            "(--suite ally-shifted-v2), or choose another folder"
        )


def test_asking_for_the_revision_writes_nothing_into_the_repository(tmp_path):
    for words in (
        ["init"],
        ["-c", "user.name=a", "-c", "user.email=a", "commit", "--allow-empty", "-m", "a"],
    ):
        run_folder._git(tmp_path, *words)
    (tmp_path / "file").write_text("content")
    run_folder._git(tmp_path, "add", ".")
    os.utime(tmp_path / "file", (1, 1))  # which a status would note in the index, under a lock
    before = (tmp_path / ".git" / "index").read_bytes()
    assert "file" in run_folder._git(tmp_path, "status", "--porcelain")
    assert (tmp_path / ".git" / "index").read_bytes() == before
