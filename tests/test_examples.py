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
    "ppo_single_file": "torch",
    "rllib_ppo": "ormsgpack",  # ray is here without what RLlib needs
    "sbx_ppo": "sbx",
    "team_ppo": "torch",
    "tianshou_ppo": "tianshou",
    "torchrl_dqn": "torchrl",
    "torchrl_ppo": "torchrl",
}
COUNTING = """
import atexit, os, runpy, sys
from fpg_bench.game.batch import GameBatch
from fpg_bench.products.teams.batch import TeamBatch

ended = []
for kind in (GameBatch, TeamBatch):
    def step(batch, *actions, step=kind.step):
        before = batch.games["truncated"].sum()
        result = step(batch, *actions)
        ended.append(batch.games["truncated"].sum() - before)
        return result
    kind.step = step
atexit.register(lambda: print(sum(ended), "rounds ended"))
sys.argv.pop(0)
sys.path.insert(0, os.path.dirname(sys.argv[0]))  # as a script's own folder is
runpy.run_path(sys.argv[0], run_name="__main__")
"""
DISCRETE = ("benchmarl_qmix", "dqn_single_file", "torchrl_dqn")


@pytest.mark.full
@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize(("name", "needs"), NEEDS.items())
def test_an_example_trains_and_leaves_an_agent(name, needs, tmp_path):
    if importlib.util.find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    words = ["--steps", 1300, "--envs", 4, "--out", tmp_path / "agent"]
    if name != "dqn_single_file":  # it learns in each step
        words += ["--rollout", 64]
    run = python("-c", COUNTING, ROOT / "examples" / f"{name}.py", *words)
    assert run.returncode == 0, run.stderr
    assert re.search(r"\d+ steps per CPU second", run.stdout)
    if name != "rllib_ppo":  # its games are in other processes
        assert int(re.search(r"(\d+) rounds ended", run.stdout)[1]) >= 4
    agent = fpg_bench.load_agent(tmp_path / "agent")
    actions, _ = agent.predict(np.random.default_rng(0).uniform(-1, 1, (3, agent.size)).astype(np.float32))
    assert actions.shape == (3, 9)
    if name == "team_ppo":
        (row,) = fpg_bench.evaluate({name: str(tmp_path / "agent")}, "team-ally-link-v1", matches=1)
        assert (row.entry, row.training.steps) == (name, 6 * 4 * 64 * 3)
    if name in DISCRETE:
        rows = Choices("ally", "discrete", STANDARD).lists[0].rows
        assert agent.card.game.actions == "discrete"
        assert (actions[:, None] == rows).all(2).any(1).all()


def test_all_examples_are_run_and_short():
    files = {file.stem: file for file in (ROOT / "examples").glob("*.py")}
    assert files.keys() == NEEDS.keys() | {"llama_server"}  # tests of language models ask that one
    assert all(len(file.read_text().splitlines()) <= 100 for file in files.values())


def kind_of(code):
    """Return how Jupyter runs a cell."""
    return {"!": "bash", "%": "magic"}.get(code[0], "python")


@pytest.mark.full
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
    cells = code_cells(name)
    install, *codes = ("".join(cell["source"]) for cell in cells)
    assert install.startswith("%pip install")
    reader = Reader(tmp_path / "here", small_baselines(tmp_path / "baselines"), MPLBACKEND="agg")
    reader.writes("IPython/__init__.py", "get_ipython = lambda: None\nversion_info = (9, 0)")
    reader.writes("IPython/display.py", "Image = lambda *_, **__: None")
    said = ""
    for kind, group in itertools.groupby(codes, kind_of):
        before = len(reader.said)
        code = small(re.sub("(?m)^!", "", "\n".join(group)))
        reader.does(kind, code.replace("--n-evals 0", "--n-evals 1"))  # curves need one
        if kind == "python":
            said += reader.said[before:]
    assert re.search(last, reader.said)
    assert re.search(last, "".join(map(printed_by, cells)))
    printed = "".join(printed_by(cell) for cell in cells if kind_of("".join(cell["source"])) == "python")
    assert lines_without_numbers(printed) == lines_without_numbers(said)


def code_cells(name):
    """Return the cells of a notebook that hold code."""
    cells = json.loads((ROOT / "examples" / f"{name}.ipynb").read_text())["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def printed_by(cell):
    """Return what a cell has printed when its outputs were made."""
    return "".join("".join(each["text"]) for each in cell["outputs"] if each["output_type"] == "stream")


def lines_without_numbers(text):
    """Return the lines in any order, as better players come first in tables."""
    return sorted(re.sub(r"(?:\bnan\b|[-\d.\s])+", " ", line) for line in text.splitlines())


@pytest.mark.parametrize(
    ("name", "pictures", "most_kb"),
    [("quick_start", 4, 400), ("enter_the_board", 1, 300), ("offline_learning", 1, 300)],
)
def test_the_outputs_of_a_notebook_are_committed_and_small(name, pictures, most_kb):
    assert (ROOT / "examples" / f"{name}.ipynb").stat().st_size < most_kb * 1000
    install, *cells = code_cells(name)
    assert not install["outputs"]
    assert [cell["execution_count"] for cell in cells] == list(range(2, len(cells) + 2))
    kinds = [kind for cell in cells for each in cell["outputs"] for kind in each.get("data", ())]
    assert kinds.count("image/png") == pictures
