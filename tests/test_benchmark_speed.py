"""The speed report runs and shows every figure; no test measures speed itself."""

from pathlib import Path

import pytest

from tests.programs import python

SCRIPT = Path(__file__).parents[1] / "scripts" / "benchmark_speed.py"


@pytest.mark.process
def test_every_figure_but_long_ones_is_shown_and_memory_keeps_its_bounds():
    report = python(SCRIPT, "--quick")
    assert report.returncode == 0, report.stderr
    lines = report.stdout.splitlines()
    measured = [line for line in lines if line.startswith("bytes")]  # whatever the load of the machine
    timed = [line for line in lines if line not in measured]  # too short for a verdict
    assert (len(timed), len(measured)) == (13, 2)
    assert all(float(line.rsplit(maxsplit=3)[1]) > 0 for line in timed)
    assert all(line.endswith(" reached") and "NOT" not in line for line in measured)
