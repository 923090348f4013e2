"""Variants: each round draws its rules, by its own key."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD, Scenario, as_scenario, preset

RANGES = {
    "preset": "link",
    "opponent_power_dbm": [30, 42],
    "hop_airtime_s": [0.1, 0.5],
    "check_interval_s": [[1, 1], [6, 8]],
}
DRAWN = as_scenario(["link", RANGES, "link-fast-hop"])


def played(scenario, seeds, rounds=3, steps=20, **options) -> tuple[GameBatch, np.ndarray]:
    """A batch after some rounds of random actions, and the rules of each round."""
    batch, drawn = GameBatch(scenario, len(seeds), **options), []
    for number in range(rounds):
        batch.reset(seeds=None if number else seeds)
        drawn.append(batch.games["rules"].copy())
        chance = np.random.default_rng(number)
        for _ in range(steps):
            actions = chance.uniform(-1, 1, (2, 1, 9)).astype(np.float32)
            batch.step(*np.repeat(actions, len(seeds), axis=1))
    return batch, np.array(drawn)


def test_a_round_is_that_of_the_scenario_which_it_draws():
    batch, drawn = played(DRAWN, list(range(12)))
    assert len(set(drawn.ravel())) > 20  # nearly all of 36 rounds differ
    for game, rules in enumerate(drawn[-1]):
        alone, _ = played(batch.drawn[rules], [game])
        for name in set(batch.games.dtype.names) - {"rules"}:
            assert np.array_equal(alone.games[name][0], batch.games[name][game]), name
        assert np.array_equal(alone.ally_observations[0], batch.ally_observations[game])


def test_what_a_round_draws_depends_on_its_key_alone():
    batch, drawn = played(DRAWN, list(range(1200)), rounds=2, steps=2, threads=2)
    assert len(np.unique(drawn[0])) > 200
    for game in (0, 7, 1199):
        alone, of = played(pickle.loads(pickle.dumps(DRAWN)), [game], rounds=2, steps=2)
        assert np.array_equal(of[:, 0], drawn[:, game])
        assert alone.games[0]["snr_db"] == batch.games[game]["snr_db"]


def test_variants_are_drawn_equally_often_and_ranges_evenly():
    batch, drawn = played(DRAWN, list(range(3000)), rounds=1, steps=0)
    assert np.abs(np.bincount(drawn[0].astype(int) % 3) / 3000 - 1 / 3).max() < 0.03
    ranged = batch.drawn[1::3]
    powers = np.array([each.opponent_power_dbm for each in ranged])
    assert powers.min() >= 30
    assert powers.max() <= 42
    assert abs(powers.mean() - 36) < 1
    intervals = {each.check_interval_s for each in ranged}
    assert {(1, 1), (6, 8)} < intervals
    assert all(low <= high for low, high in intervals)
    airtimes = np.array([each.hop_airtime_s for each in ranged])
    assert abs(np.corrcoef(powers, airtimes)[0, 1]) < 0.3  # ranges are drawn independently
    assert {each.hop_airtime_s for each in batch.drawn[2::3]} == {preset("link-fast-hop").hop_airtime_s}


def test_a_scenario_without_variants_draws_itself():
    batch, drawn = played(STANDARD, [0, 1])
    assert batch.drawn == (STANDARD,)
    assert not drawn.any()


def test_variants_are_written_down_and_read_again(tmp_path):
    assert Scenario.from_dict(DRAWN.to_dict()) == DRAWN
    DRAWN.to_yaml(tmp_path / "drawn.yml")
    again = Scenario.from_yaml(tmp_path / "drawn.yml")
    assert again == DRAWN
    assert again.hash == DRAWN.hash != preset("link").hash
    assert DRAWN.base == preset("link")
    ranges = Scenario.from_dict(RANGES)
    assert ranges.variants == DRAWN.variants[1:2]
    assert ranges.base == preset("link")
    assert hash(ranges) == hash(ranges.base)


def test_ranges_beside_variants_stand_in_each():
    given = {"hop_cost": [30, 50], "variants": [{"fading_sd_db": 2}, {"hop_cost": 60}]}
    assert Scenario.from_dict(given).variants == ({"hop_cost": (30, 50), "fading_sd_db": 2}, {"hop_cost": 60})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"opponent_power": [1, 2]}, "unknown key 'opponent_power'; did you mean 'opponent_power_dbm'?"),
        ({"hop_cost": [50, 40]}, "hop_cost: the range [50, 40] must not end below its start"),
        ({"hop_cost": [40, float("nan")]}, "hop_cost: nan is outside [0, 1e+06]"),
        ({"hop_cost": [40, -1]}, "hop_cost: -1 is outside"),
        ({"hop_cost": [40, 41, 42]}, "hop_cost: expected a number, got [40, 41, 42]"),
        ({"check_interval_s": [[2, 3], [1, 9]]}, "the range [[2, 3], [1, 9]] must not end below its start"),
        ({"check_interval_s": [[1, 2], [3]]}, "check_interval_s: expected 2 numbers, got [3]"),
        ({"steps_per_round": [100, 300]}, "variants[0]: steps_per_round must be the same in all rounds"),
        ({"variants": [{}, {"box_m": [900, 900, 600]}]}, "variants[1]: box_m must be the same in all rounds"),
        ({"variants": [{"hopping": ["gated", "always"]}]}, "hopping: unknown value ['gated', 'always']"),
        (
            {"variants": {"hop_cost": 41}},
            "variants: expected a list of mappings from fields to values or ranges",
        ),
        (
            {"variants": [{"hop_airtime_s": 0.1}]},
            "variants[0]: hop_airtime_s 0.1: for snr_model 'link' alone",
        ),
        ({"patrol_radius_m": [300, 9e4]}, "variants[0]: patrol_centre_m with patrol_radius_m 90000.0"),
        (["link", "standard"], "variants[1]: box_m must be the same in all rounds"),
        ([], "a mapping of fields, or a list of these, got []"),
    ],
)
def test_variants_that_cannot_be_played_are_refused_in_one_line(given, message):
    with pytest.raises(UserError) as refused:
        as_scenario(given)
    assert message in str(refused.value)
