"""Meetings outside any panel: on each scale random is worth 0 and the panel's reference 100."""

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.encounters import meet, scale_of
from fpg_bench.evaluation.panel import Entry, load_panel
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.scenario import PAPER, STANDARD, as_scenario

LEARNED = as_scenario(None, opponent_path="learned")


@pytest.mark.parametrize("seeds", [None, tuning_seeds])
@pytest.mark.parametrize(
    ("side", "scenario", "other", "reference"),
    [
        ("ally", STANDARD, "adaptive", "expert"),
        ("opponent", STANDARD, "expert", "adaptive"),
        ("opponent", LEARNED, "expert", "adaptive"),
        ("ally", PAPER, "adaptive", "expert"),
    ],
)
def test_random_is_worth_0_and_the_reference_100(side, scenario, other, reference, seeds):
    scale = scale_of(side, scenario, rounds=20, seeds=seeds)
    assert meet("random", {"it": other}, scale, rounds=20)["score"] == pytest.approx(0, abs=0.01)
    assert meet(reference, {"it": other}, scale, rounds=20)["score"] == pytest.approx(100, abs=0.01)


def test_the_scale_is_the_same_whoever_is_met():
    panel, others = load_panel("ally-v1"), {"mine": "tone", "yours": "comb"}
    found = meet("idle", others, scale_of("ally", STANDARD), rounds=10)
    reference = panel.references["adaptive/pursuit"]
    for name, other in others.items():
        rows = next(play_entry("idle", panel, Entry(other, "pursuit"), 10))
        expected = reference.scores(np.array([row["ally_return"] for row in rows])).mean()
        assert found["scores"][name] == pytest.approx(expected, abs=0.01)
    assert found["score"] == pytest.approx(sum(found["scores"].values()) / 2, abs=0.01)
    assert (found["measures"]["share_tone"], found["measures"]["share_comb"]) == (0.5, 0.5)


def test_a_game_in_which_the_reference_is_no_better_than_random_has_no_scale():
    powerless = as_scenario(None, opponent_power_dbm=-100, distance_reward=0)
    with pytest.raises(UserError, match="earns no more than random"):
        scale_of("opponent", powerless, rounds=5)
