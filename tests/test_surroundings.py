"""Whatever surrounds a program, verbs and public calls give the same result, or one line."""

import dataclasses
import json
import math
import os
import stat
import subprocess
import sys
import tempfile
from decimal import Decimal

import numpy as np
import pytest

import fpg_bench
from tests.programs import ROOT
from tests.training.tiny import ALLY, settings

VERBS = {
    "evaluate": ("evaluate", "idle", "--suite", "ally-v2", "--matches", "1", "--out", "made"),
    "play": ("play", "--every", "100", "--out", "made.html"),
    "train": ("train", "ppo", ALLY, "--opponent", "tone, comb", "--n-evals", "1", "--out", "made"),
}
SURROUNDINGS = {
    "notebook": ({"MPLBACKEND": "module://nowhere.backend_inline"}, 0o022),
    "plain": ({"LC_ALL": "C", "PYTHONUTF8": "0", "COLUMNS": "20", "TERM": "dumb"}, 0o027),
    "private": ({"PYTHONWARNINGS": "error::DeprecationWarning:fpg_bench", "MPLCONFIGDIR": "/proc"}, 0o077),
}


@pytest.mark.process
@pytest.mark.parametrize("surroundings", SURROUNDINGS)
@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_works_in_any_surroundings(tmp_path, verb, surroundings):
    environment, umask = SURROUNDINGS[surroundings]
    words = [*VERBS[verb]]
    if verb == "train":
        (tmp_path / "tiny.yml").write_text(json.dumps({ALLY: settings("ppo")}))
        words += ["--hyperparams", "tiny.yml"]
    done = subprocess.run(
        [sys.executable, "-m", "fpg_bench", *words],
        cwd=tmp_path,
        env=dict(os.environ) | environment | {"PYTHONPATH": str(ROOT)},
        umask=umask,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    files = [
        path
        for path in tmp_path.rglob("*")
        if path.is_file() and path.suffix != ".yml" and path.name[0] != "."
    ]
    assert {"evaluate": "table.png", "play": "made.html", "train": "curve.png"}[verb] in {
        p.name for p in files
    }
    assert not [path for path in files if stat.S_IMODE(path.stat().st_mode) & umask]


@pytest.mark.process
def test_an_argument_that_is_no_text_is_one_line(tmp_path):
    words = [sys.executable, "-m", "fpg_bench", "play", "--out", b"\xff.html"]
    done = subprocess.run(
        words, cwd=tmp_path, capture_output=True, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert (done.returncode, done.stderr.decode(errors="replace").count("\n")) == (2, 1)
    assert b"is not valid UTF-8" in done.stderr


def _run(number):
    config = fpg_bench.RunConfig("ppo", ALLY, seed=number, steps=number)
    return config, type(config.seed), type(config.steps)


def _logged(number, **options):
    about = {"seconds": number, "training_seed": number, "algorithm": "x", "rounds": number} | options
    with tempfile.TemporaryDirectory() as folder:
        return fpg_bench.log_evaluation(about.pop("folder", folder), "idle", number, **about)


# Public calls that take whole numbers
NUMBERS = {
    "run": _run,
    "log_evaluation": _logged,
    "evaluate": lambda number: fpg_bench.evaluate("idle", matches=number)[0].score,
    "evaluator": lambda number: fpg_bench.PolicyEvaluator("ally-v2", number).suite.matches,
    "game": lambda number: fpg_bench.GameSpec(ALLY, observation="waterfall", history=number).to_dict(),
    "games": lambda number: fpg_bench.make_sb3(ALLY, number, seed=number).reset().tolist(),
    "duel": lambda number: fpg_bench.make_duel(number).reset(seeds=number).tolist(),
    "scenario": lambda number: dataclasses.replace(fpg_bench.preset("standard"), hop_cost=number).hash,
}


@pytest.mark.parametrize("call", NUMBERS.values(), ids=NUMBERS)
def test_whole_numbers_may_be_those_of_numpy_and_what_is_none_is_one_line(call):
    plain = call(3)
    for kind in (np.int64, np.uint8, np.int16):
        assert call(kind(3)) == plain
    for other in ("3", True, np.True_, Decimal(3), np.array([3])):
        with pytest.raises(fpg_bench.UserError) as error:
            call(other)
        assert "\n" not in str(error.value)


def _trained(**options):
    how = {name: options.pop(name) for name in ("config", "out", "evaluations") if name in options}
    with tempfile.TemporaryDirectory() as folder:
        config = fpg_bench.RunConfig(**{"algorithm": "ppo", "game": ALLY} | options)
        return fpg_bench.train(**{"config": config, "out": folder} | how)


# What is none of a kind, and the public calls that take such a value
WRONG = {
    "number": ("many", None, True, math.nan, math.inf, -1, 10**400, [3], 3j),
    "name": (3, True, b"x", math.nan, [3], {"a": {1}}, len),
    "path": (3, True, b"x", "a\0b", "\ud800", [3]),
    "mapping": ("text", 3, True, [3]),
}
CALLS = {
    "log_evaluation's seconds": ("number", lambda value: _logged(1, seconds=value)),
    "log_evaluation's steps": ("number", _logged),
    "train's evaluations": ("number", lambda value: _trained(evaluations=value)),
    "RunConfig's seed": ("number", lambda value: _trained(seed=value)),
    "make_sb3's games": ("number", lambda value: fpg_bench.make_sb3(ALLY, value)),
    "make_duel's games": ("number", fpg_bench.make_duel),
    "supersuit_vec_env's games": ("number", fpg_bench.supersuit_vec_env),
    "evaluate's workers": ("number", lambda value: fpg_bench.evaluate("idle", matches=1, workers=value)),
    "log_evaluation's algorithm": ("name", lambda value: _logged(1, algorithm=value)),
    "log_evaluation's suite": ("name", lambda value: _logged(1, suite=value)),
    "evaluate's players": ("name", fpg_bench.evaluate),
    "evaluate's player": ("name", lambda value: fpg_bench.evaluate([value])),
    "evaluate's suite": ("name", lambda value: fpg_bench.evaluate("idle", value)),
    "PolicyEvaluator's suite": ("name", fpg_bench.PolicyEvaluator),
    "RunConfig's algorithm": ("name", lambda value: _trained(algorithm=value)),
    "RunConfig's suite": ("name", lambda value: _trained(suite=value)),
    "RunConfig's start": ("path", lambda value: _trained(start=value)),
    "GameSpec's id": ("name", fpg_bench.GameSpec),
    "preset": ("name", fpg_bench.preset),
    "train's configuration": ("name", lambda value: _trained(config=value)),
    "train's folder": ("path", lambda value: _trained(out=value)),
    "log_evaluation's folder": ("path", lambda value: _logged(1, folder=value)),
    "evaluate's folder": ("path", lambda value: fpg_bench.evaluate("idle", matches=1, out=value)),
    "Run's folder": ("path", fpg_bench.Run),
    "load_agent": ("path", fpg_bench.load_agent),
    "write_agent": ("path", lambda value: fpg_bench.write_agent(value, b"", id=ALLY)),
    "RunConfig's hyper-parameters": ("mapping", lambda value: _trained(hyperparams=value)),
    "RunConfig's planner": ("mapping", lambda value: _trained(planner_options=value)),
    "evaluate's planner": ("mapping", lambda value: fpg_bench.evaluate("idle", planner_options=value)),
    "Scenario": ("mapping", fpg_bench.Scenario.from_dict),
}


@pytest.mark.parametrize(("kind", "call"), CALLS.values(), ids=CALLS)
def test_a_call_says_in_one_line_what_it_takes(kind, call):
    for wrong in WRONG[kind]:
        with pytest.raises(fpg_bench.UserError) as error:
            call(wrong)
        assert str(error.value).isprintable()
        assert len(str(error.value)) < 1500


PROGRAM = """\
import fpg_bench

results = fpg_bench.evaluate(["expert"], "ally-v2", matches=1)
names: list[str] = [summary.entry for summary in results]
config = fpg_bench.RunConfig("ppo", fpg_bench.GameSpec("FPG/AllyVsScripted-v0"), seed=1)
seed: int = config.seed
wrong: str = config.seed
"""


@pytest.mark.slow
@pytest.mark.process
def test_a_user_s_program_is_type_checked_as_the_package_says(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "fpg_bench").symlink_to(ROOT / "fpg_bench")
    assert (ROOT / "fpg_bench" / "py.typed").is_file()
    words = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "program.py"]
    environment = {**os.environ, "MYPYPATH": str(tmp_path / "found")}
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert [line.split(":")[1] for line in done.stdout.splitlines()[:-1]] == ["7"], done.stdout


@pytest.mark.process
@pytest.mark.parametrize("words", [("-m", "fpg_bench", "envs"), ("-c", "import fpg_bench")])
def test_ctrl_c_while_modules_are_imported_is_one_line_of_the_command_line_alone(tmp_path, words):
    (tmp_path / "gymnasium.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True)
    expected = (130, "fpg-bench: stopped") if words[0] == "-m" else (-2, "KeyboardInterrupt")
    assert (done.returncode, done.stderr.splitlines()[-1]) == expected
    assert len(done.stderr.splitlines()) == 1 or words[0] == "-c"
