"""The speed report runs and shows every figure; how fast anything is, no test asks."""

import json
from pathlib import Path

import pytest

from tests.programs import python

pytestmark = pytest.mark.process

SCRIPT = Path(__file__).parents[1] / "scripts" / "benchmark_speed.py"

FIGURES = (
    "arena, one thread / CartPole-v1",
    "arena, two threads / CartPole-v1",
    "one Gymnasium view / CartPole-v1",
    "PettingZoo duel / mpe2 simple_adversary",
    "memory a game",
    "allocated in a step a game",
    "stepping make_sb3 / 64 single views",
    "PPO on make_sb3 / on 64 single views",
    "PPO on zeros / on 64 single views",
    "PPO on make_sb3 / on zeros",
    "import fpg_bench beyond import gymnasium",
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    file = tmp_path_factory.mktemp("speed") / "speed.json"
    done = python(SCRIPT, "--quick", "--json", file)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), json.loads(file.read_text())


def test_table_has_a_line_and_a_verdict_for_every_figure(report):
    header, *lines = report[0]
    assert header.split() == ["figure", "measured", "asked", "for"]
    assert [line.split("  ")[0] for line in lines] == list(FIGURES)
    assert all(line.endswith(("reached", "(comparison)")) for line in lines)


def test_json_holds_the_same_figures_and_the_machine(report):
    figures = report[1]["figures"]
    assert [figure["name"] for figure in figures] == list(FIGURES)
    assert report[1]["machine"]["cpus"] >= 1
    for figure in figures:
        if figure["asked"] is None:
            assert figure["reached"] is None
        elif figure["at_least"]:
            assert figure["reached"] == (figure["value"] >= figure["asked"])
        else:
            assert figure["reached"] == (figure["value"] <= figure["asked"])


def test_memory_keeps_its_bounds(report):
    """Bytes do not depend on the machine's load, so these two verdicts may be asked for."""
    values = {figure["name"]: figure for figure in report[1]["figures"]}
    assert values["memory a game"]["reached"]
    assert values["allocated in a step a game"]["reached"]


@pytest.mark.parametrize(("name", "count"), [("planning", 6), ("training", 7)])
def test_the_other_reports_show_every_figure(name, count, tmp_path):
    script = SCRIPT.with_name(f"benchmark_{name}.py")
    done = python(script, "--quick", "--json", tmp_path / "figures.json")
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())["figures"]
    assert [line.split("  ")[0] for line in done.stdout.splitlines()[1:]] == [f["name"] for f in figures]
    assert len(figures) == count
    assert all(figure["value"] > 0 for figure in figures)
