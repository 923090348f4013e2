import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import (
    TUNING_START,
    dataset_seed,
    evaluation_seeds,
    training_seed,
    tuning_seeds,
)
from fpg_bench.products.leaderboard.season_keys import SeasonKey

LAST_TRAINING = TUNING_START // 10**6 - 1


def test_ranges_never_meet():
    assert training_seed(0) == 0
    last_training = training_seed(LAST_TRAINING) + 10**6 - 1
    assert last_training < min(tuning_seeds(1000)) <= max(tuning_seeds(1000)) < min(evaluation_seeds(1))
    for season in ("0", "1", "spring"):
        seeds = evaluation_seeds(1000, season)
        assert max(tuning_seeds(1000)) < min(seeds) <= max(seeds) < 2**63


def test_seasons_differ_and_each_is_public():
    assert not set(evaluation_seeds(1000, "0")) & set(evaluation_seeds(1000, "1"))
    assert evaluation_seeds(3) == evaluation_seeds(1000)[:3]
    assert tuning_seeds(3) == tuning_seeds(1000)[:3]


def test_seeds_out_of_range_are_refused():
    for seeds, most in ((tuning_seeds, 2**41), (evaluation_seeds, 2**20 + 1)):
        with pytest.raises(UserError, match="asked for"):
            seeds(most)
    for k in (-1, LAST_TRAINING + 1):
        with pytest.raises(UserError, match="training seed"):
            training_seed(k)


def test_data_sets_have_seeds_above_all_others():
    last_evaluation = 2**41 + 2**20 * 2**20
    assert last_evaluation <= dataset_seed(0) < dataset_seed(1) < dataset_seed(2**30 - 1) < 2**63
    assert dataset_seed(1) - dataset_seed(0) == 2**32
    for k in (-1, 2**30):
        with pytest.raises(UserError, match="seed of a data set"):
            dataset_seed(k)


def test_a_season_met_an_entry_with_just_these_policies():
    key = SeasonKey(4, "seed", {"ally/mine": ("a", "b")})
    assert key.met("ally/mine", ["a", "b"])
    for policies in (["a"], ["a", "b", "c"], ["b", "a"], []):
        assert not key.met("ally/mine", policies)
    assert not key.met("ally/other", ["a", "b"])
    assert key.met("ally/other", [])
