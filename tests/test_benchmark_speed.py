"""The speed report runs and shows every figure; no test measures speed itself."""

from pathlib import Path

import pytest

from tests.programs import python

SCRIPT = Path(__file__).parents[1] / "scripts" / "benchmark_speed.py"


@pytest.mark.process
def test_every_figure_is_shown_and_memory_keeps_its_bounds():
    report = python(SCRIPT, "--quick")
    assert report.returncode == 0, report.stderr
    lines = [line for line in report.stdout.splitlines() if line.endswith("reached")]
    assert len(lines) == 11
    for line in lines:
        if line.startswith("bytes"):  # which do not depend on the load of the machine
            assert line.endswith(" reached")
            assert "NOT" not in line
