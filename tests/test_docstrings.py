"""Docstrings: every public name has an example, all of them run, and none begins as a question."""

import ast
import doctest
import importlib
import re

import pytest

import fpg_bench
from tests.environments import ROOT

_PUBLIC = [name for name in fpg_bench.__all__ if not name.startswith("__")]
_OTHERS = [
    "fpg_bench.envs.gymnasium_env.FPGEnv",
    "fpg_bench.envs.gymnasium_vector.FPGVectorEnv",
    "fpg_bench.envs.pettingzoo_env.FPGParallelEnv",
    "fpg_bench.evaluation.suite.suite_of",
    "fpg_bench.game.batch.GameBatch",
    "fpg_bench.game.choices.Choices",
    "fpg_bench.game.waterfall.Waterfall",
    "fpg_bench.players.planner.as_planner",
    "fpg_bench.products.maddpg.maddpg.MADDPG",
    "fpg_bench.training.train.train",
]


def found(name):
    """Return a public object by its name."""
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(module), attribute)


@pytest.mark.parametrize("name", [*(f"fpg_bench.{name}" for name in _PUBLIC), *_OTHERS])
def test_a_public_name_has_an_example_that_runs(name, tmp_path, monkeypatch):
    if name.endswith("supersuit_vec_env"):
        pytest.importorskip("supersuit")
    thing = found(name)
    monkeypatch.chdir(tmp_path)
    home = vars(importlib.import_module(thing.__module__))
    tests = doctest.DocTestFinder(recurse=True).find(thing, name, globs=home)
    assert sum(len(test.examples) for test in tests), "has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    lines = []
    for test in tests:
        runner.run(test, out=lines.append)
    assert not runner.failures, "".join(lines)
    assert not list(tmp_path.iterdir()), "leaves files behind"


def docstrings(file):
    """The docstrings of a module and of all that it defines."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def test_no_docstring_begins_with_a_question_s_word():
    words = re.compile(r"(What|Where|Which|Who|Whom|Whose|Why|How)\b")
    files = [file for folder in ("fpg_bench", "scripts", "tests") for file in (ROOT / folder).rglob("*.py")]
    found = {file.name: text for file in files for text in docstrings(file) if words.match(text)}
    assert files
    assert not found
