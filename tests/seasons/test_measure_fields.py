"""The script that compares two closings, on profiles that are made up."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.rows import RowFile
from tests.programs import python
from tests.seasons.closing import REPOSITORY

pytestmark = pytest.mark.process


def make_closing(folder, seed, noise):
    """Six candidates; four trained entries of two training seeds each, and a script that is far off."""
    rng = np.random.default_rng(seed)
    for k in range(6):
        rows = []
        for strength, name in enumerate("abcd"):
            for player in (f"{name}/seed_0", f"{name}/seed_1"):
                earned = float(strength + noise * rng.normal())
                rows.append({"entry": f"ally/{name}", "player": player, "n": 2, "ally": earned})
        rows.append({"entry": "ally/idle", "player": "idle", "n": 2, "ally": -50.0})
        RowFile(folder / "opponent" / f"o{k:02d}" / "profile.jsonl").append(rows)
    (folder / "opponent" / "o06").mkdir()
    RowFile(folder / "opponent" / "o06" / "profile.jsonl").append(rows[:3])  # not all have met it yet
    return folder


def told(*folders):
    found = python(REPOSITORY / "scripts/measure_fields.py", *folders, "--side", "opponent")
    assert found.returncode == 0, found.stderr
    return found.stdout.splitlines()


def test_closings_that_rank_alike_agree_at_every_size(tmp_path):
    a, b = (make_closing(tmp_path / str(seed), seed, noise=0.01) for seed in (1, 2))
    lines = told(a, b)
    assert lines[0] == "opponents: 6 and 6 candidates, 4 trained entries"
    assert "| mean, representative | 1.00 | 1.00 | 1.00 | 1.00 |" in lines
    assert "| worst, diverse | 1.00 | 1.00 | 1.00 | 1.00 |" in lines


def test_noise_shows_in_small_fields(tmp_path):
    a, b = (make_closing(tmp_path / str(seed), seed, noise=6) for seed in (1, 2))
    (line,) = (line for line in told(a, b) if line.startswith("| mean, random"))
    assert line != "| mean, random | 1.00 (1.00) | 1.00 (1.00) | 1.00 (1.00) | 1.00 |"
