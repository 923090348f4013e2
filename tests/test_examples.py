"""The examples run at tiny size and leave an agent that plays; one whose framework is missing is skipped."""

import importlib.util
import re

import numpy as np
import pytest

import fpg_bench
from tests.programs import ROOT, python

NEEDS = {
    "benchmarl_maddpg": "benchmarl",
    "ppo_single_file": "torch",
    "sbx_ppo": "sbx",
    "torchrl_ppo": "torchrl",
}


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize(("name", "needs"), NEEDS.items())
def test_an_example_trains_and_leaves_an_agent(name, needs, tmp_path):
    if importlib.util.find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    words = ("--steps", 300, "--envs", 4, "--rollout", 64, "--out", tmp_path / "agent")
    run = python(ROOT / "examples" / f"{name}.py", *words)
    assert run.returncode == 0, run.stderr
    assert re.search(r"\d+ steps per CPU second", run.stdout)
    actions, _ = fpg_bench.load_agent(tmp_path / "agent").predict(np.zeros((3, 15), np.float32))
    assert actions.shape == (3, 9)


def test_all_examples_are_run_and_short():
    files = {file.stem: file for file in (ROOT / "examples").glob("*.py")}
    assert files.keys() == NEEDS.keys()
    assert all(len(file.read_text().splitlines()) <= 100 for file in files.values())
