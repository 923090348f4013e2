"""Whole matches of both presets, kept as a few sums: what is played must not move unnoticed.

A change here is a change of the rules (then every id that it touches needs a new version) or of the chance
behind them. Only the last bits may differ, between machines and compilers.
"""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import preset

from .playing import begin, wander

GOLDEN = {
    "standard": {
        "ally_return": -11803.615106433132,
        "opponent_return": 26313.915106433134,
        "snr_db": 56565.0315351921,
        "capacity_mbit_s": 97621.41138802399,
        "overlap": 265,
        "jammed": 201,
        "outage": 201,
        "heard": 218,
        "hops": 600,
        "spread": 675,
        "near": 895,
        "comb": 311,
        "recovery_steps": 153,
        "positions_m": 13900.743965193242,
        "ally_observations": 6350.507203797184,
        "opponent_observations": 6172.839637169825,
    },
    "paper": {
        "ally_return": -2096.5829794590773,
        "opponent_return": 8669.91779619635,
        "snr_db": 22942.11702054092,
        "capacity_mbit_s": 8650306.055679921,
        "overlap": 89,
        "jammed": 10,
        "outage": 10,
        "heard": 34,
        "hops": 200,
        "spread": 223,
        "near": 151,
        "comb": 102,
        "recovery_steps": 6,
        "positions_m": 12888.929704916784,
        "ally_observations": 2407.8239508396364,
        "opponent_observations": 2338.8105085375355,
    },
}


def played(name: str) -> dict[str, float]:
    """Sums over one round of four games of a preset, played by sines."""
    scenario = preset(name)
    batch = begin(scenario, seed=2025, games=4)
    seen = np.zeros(2)
    for actions in zip(*wander(8, scenario.steps_per_round, 4), strict=True):
        batch.step(*actions)
        observations = (batch.ally_observations, batch.opponent_observations)
        seen += [np.abs(o.astype(float)).sum() for o in observations]
    tallies = batch.tallies
    names = ("ally_return", "opponent_return", "snr_db", "capacity_mbit_s")
    counts = ("overlap", "jammed", "outage", "heard", "hops", "spread", "near", "comb", "recovery_steps")
    return {
        **{field: float(tallies[field].sum()) for field in names},
        **{field: int(tallies[field].sum()) for field in counts},
        "positions_m": float(batch.games["ally_position"].sum() + batch.games["opponent_position"].sum()),
        "ally_observations": float(seen[0]),
        "opponent_observations": float(seen[1]),
    }


@pytest.mark.parametrize("name", GOLDEN)
def test_a_match_is_the_one_it_was(name):
    found = played(name)
    for field, value in GOLDEN[name].items():
        tolerance = 1e-6 if field.endswith("observations") else 1e-9  # observations: single precision
        assert found[field] == pytest.approx(value, rel=tolerance), f"{field} of {found}"
