"""Observations of each side, entry by entry, and the errors of the ally's spectrum monitor."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD

from .playing import BROADBAND, ally, begin, opponent


def test_how_wrong_sensing_is():
    """1 MHz of Gaussian error, drawn every step; the type wrong at 10 %, each other type alike."""
    games, steps = 1000, 10
    batch = begin(STANDARD, games=games)
    errors, types = [], []
    jam = opponent(BROADBAND, tuning=0.2, in_band=True).repeat(games, 0)
    for _ in range(steps):
        batch.step(ally().repeat(games, 0), jam)
        errors.append(batch.games["sensed_mhz"] - batch.games["jamming_mhz"])
        types.append(batch.games["sensed_type"].copy())
    errors, types = np.array(errors), np.array(types)
    assert abs(errors.mean()) < 0.05
    assert errors.std() == pytest.approx(1.0, abs=0.04)
    assert (abs(errors) > 1.96).mean() == pytest.approx(0.05, abs=0.01)
    assert abs(np.corrcoef(errors[0], errors[1])[0, 1]) < 0.15, "drawn anew every step"
    shares = np.bincount(types.ravel(), minlength=4) / types.size
    np.testing.assert_allclose(shares, [1 / 30, 1 / 30, 0.9, 1 / 30], atol=0.012)
