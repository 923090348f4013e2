"""The speed report runs and shows every figure; no test measures speed itself."""

import json
from pathlib import Path

import pytest

from tests.programs import python

pytestmark = pytest.mark.process

SCRIPT = Path(__file__).parents[1] / "scripts" / "benchmark_speed.py"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    file = tmp_path_factory.mktemp("speed") / "speed.json"
    done = python(SCRIPT, "--quick", "--json", file)
    assert done.returncode == 0, done.stderr
    table = done.stdout[done.stdout.index("figure ") :]  # pygame may print its version first
    return table.splitlines(), json.loads(file.read_text())


def test_table_and_json_have_the_same_figures(report):
    (header, *lines), content = report
    assert header.split() == ["figure", "measured", "bound"]
    assert [line.split("  ")[0] for line in lines] == [figure["name"] for figure in content["figures"]]
    assert len(lines) == 11
    assert all(line.endswith(("reached", "(comparison)")) for line in lines)
    assert content["machine"]["cpus"] >= 1


def test_memory_keeps_its_bounds(report):
    """Memory does not depend on the load of the machine."""
    figures = {figure["name"]: figure for figure in report[1]["figures"]}
    assert figures["memory per game"]["is_reached"]
    assert figures["allocated per step and game"]["is_reached"]
