"""The speed report runs and shows every figure; no test measures speed itself."""

from pathlib import Path

import pytest

from tests.programs import python

SCRIPT = Path(__file__).parents[1] / "scripts" / "benchmark_speed.py"


@pytest.mark.process
def test_every_figure_but_long_ones_is_shown():
    report = python(SCRIPT, "--quick")
    assert report.returncode == 0, report.stderr
    lines = report.stdout.splitlines()
    assert len(lines) == 8
    assert all(float(line.rsplit(maxsplit=3)[1]) > 0 for line in lines)
