"""The examples run at tiny size and leave an agent that plays; one whose framework is missing is skipped."""

import importlib.util
import itertools
import json
import re

import numpy as np
import pytest

import fpg_bench
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import STANDARD
from tests.pages import Reader, small, small_baselines
from tests.programs import ROOT, python

NEEDS = {
    "agilerl_ppo": "agilerl",
    "benchmarl_maddpg": "benchmarl",
    "benchmarl_qmix": "benchmarl",
    "dqn_single_file": "torch",
    "ppo_fast": "torch",
    "ppo_single_file": "torch",
    "rllib_ppo": "ormsgpack",  # ray is here without what RLlib needs
    "sbx_ppo": "sbx",
    "tianshou_ppo": "tianshou",
    "torchrl_dqn": "torchrl",
    "torchrl_ppo": "torchrl",
}
DISCRETE = ("benchmarl_qmix", "dqn_single_file", "torchrl_dqn")


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize(("name", "needs"), NEEDS.items())
def test_an_example_trains_and_leaves_an_agent(name, needs, tmp_path):
    if importlib.util.find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    words = ["--steps", 300, "--envs", 4, "--out", tmp_path / "agent"]
    if name != "dqn_single_file":  # it learns in each step
        words += ["--rollout", 64]
    run = python(ROOT / "examples" / f"{name}.py", *words)
    assert run.returncode == 0, run.stderr
    assert re.search(r"\d+ steps per CPU second", run.stdout)
    agent = fpg_bench.load_agent(tmp_path / "agent")
    actions, _ = agent.predict(np.random.default_rng(0).uniform(-1, 1, (3, 15)).astype(np.float32))
    assert actions.shape == (3, 9)
    if name in DISCRETE:
        rows = Choices("ally", "discrete", STANDARD).lists[0].rows
        assert agent.card.game.actions == "discrete"
        assert agent.row_wise
        assert (actions[:, None] == rows).all(2).any(1).all()


def test_all_examples_are_run_and_short():
    files = {file.stem: file for file in (ROOT / "examples").glob("*.py")}
    assert files.keys() == NEEDS.keys()
    assert all(len(file.read_text().splitlines()) <= 100 for file in files.values())


def kind_of(code):
    """Return how Jupyter runs a cell."""
    return {"!": "bash", "%": "magic"}.get(code[0], "python")


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "last"),
    [
        ("quick_start", "mine .* score"),
        ("enter_the_board", "my-first: nothing is wrong"),
        ("offline_learning", "my-iql: nothing is wrong"),
    ],
)
def test_a_notebook_runs_from_its_first_cell_to_its_last(name, last, tmp_path):
    notebook = json.loads((ROOT / "examples" / f"{name}.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    install, *cells = cells
    assert re.fullmatch(r'%pip install --quiet "fpg-bench\[[\w,]+\]"', install)
    reader = Reader(tmp_path / "here", small_baselines(tmp_path / "baselines"), MPLBACKEND="agg")
    reader.writes("IPython/__init__.py", "get_ipython = lambda: None\nversion_info = (9, 0)")
    reader.writes("IPython/display.py", "Image = lambda *_, **__: None")
    for kind, codes in itertools.groupby(cells, kind_of):
        reader.does(kind, small(re.sub("(?m)^!", "", "\n".join(codes))))
    assert re.search(last, reader.said)
    if printed := [
        "".join(each["text"])
        for cell in notebook["cells"]
        for each in cell.get("outputs", ())
        if each["output_type"] == "stream"
    ]:
        assert lines_without_numbers("".join(printed)) == lines_without_numbers(reader.said)


def lines_without_numbers(text):
    """Return the lines in any order, as better players come first in tables."""
    return sorted(re.sub(r"(?:\bnan\b|[-\d.\s])+", " ", line) for line in text.splitlines())


def test_the_outputs_of_the_first_notebook_are_committed_and_small():
    file = ROOT / "examples" / "quick_start.ipynb"
    _, *cells = (cell for cell in json.loads(file.read_text())["cells"] if cell["cell_type"] == "code")
    assert file.stat().st_size < 400_000
    kinds = [{kind for each in cell["outputs"] for kind in each.get("data", ("text",))} for cell in cells]
    assert kinds == [{"text"}, {"image/png"}, set(), *[{"image/png"}] * 3, {"text"}, {"text"}]
