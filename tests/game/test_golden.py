"""Whole matches of three presets, kept as a few sums: what is played must not move unnoticed.

A change here is a change of the rules (then every id that it touches needs a new version) or of the chance
behind them. The tolerance is for actions made of sines; ``test_bits.py`` compares bits.
"""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import preset

from .playing import begin, wander

FIELDS = (
    *("ally_return", "opponent_return", "snr_db", "capacity_mbit_s"),
    *("overlap", "jammed", "outage", "heard", "hops", "spread", "near", "comb", "recovery_steps"),
)
GOLDEN = {
    "standard": {
        "tallies": [
            *(-11803.615106433132, 26313.915106433134, 56565.0315351921, 97621.41138802399),
            *(265, 201, 201, 218, 600, 675, 895, 311, 153),
        ],
        "positions_m": 13900.743965193242,
        "observations": [6350.507203797184, 6172.839637169825],
    },
    "paper": {
        "tallies": [
            *(-2096.5829794590773, 8669.91779619635, 22942.11702054092, 8650306.055679921),
            *(89, 10, 10, 34, 200, 223, 151, 102, 6),
        ],
        "positions_m": 12888.929704916784,
        "observations": [2407.8239508396364, 2338.8105085375355],
    },
    "link": {
        "tallies": [
            *(6899.533060299249, 1619.724424356935, 18463.80940176022, 13233.096611400757),
            *(636, 73, 73, 263, 600, 675, 142, 311, 61),
        ],
        "positions_m": 14139.139998765375,
        "observations": [6173.006371076277, 6157.808237424778],
    },
}


@pytest.mark.parametrize("name", GOLDEN)
def test_a_match_is_the_one_it_was(name):
    """Sums over one round of four games of a preset, played by sines."""
    scenario = preset(name)
    batch = begin(scenario, seed=2025, games=4)
    seen = np.zeros(2)
    for actions in zip(*wander(8, scenario.steps_per_round, 4), strict=True):
        batch.step(*actions)
        observations = (batch.ally_observations, batch.opponent_observations)
        seen += [np.abs(o.astype(float)).sum() for o in observations]
    positions = batch.games["ally_position"].sum() + batch.games["opponent_position"].sum()
    assert [batch.tallies[field].sum() for field in FIELDS] == pytest.approx(
        GOLDEN[name]["tallies"], rel=1e-9
    )
    assert positions == pytest.approx(GOLDEN[name]["positions_m"], rel=1e-9)
    assert seen == pytest.approx(GOLDEN[name]["observations"], rel=1e-6)  # of single precision
