import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import (
    TUNING_START,
    dataset_seed,
    evaluation_seeds,
    training_seed,
    tuning_seeds,
)

LAST_TRAINING = TUNING_START // 10**6 - 1


def test_ranges_never_meet():
    assert (tuning_seeds(1), evaluation_seeds(1), dataset_seed(0)) == ([2**40], [2_657_666_203_648], 2**42)
    assert training_seed(0) == 0
    last_training = training_seed(LAST_TRAINING) + 10**6 - 1
    assert last_training < min(tuning_seeds(1000)) <= max(tuning_seeds(1000)) < min(evaluation_seeds(1))
    for season in ("0", "1", "spring"):
        numbers = evaluation_seeds(1000, season)
        assert max(tuning_seeds(1000)) < min(numbers) <= max(numbers) < 2**63


def test_seasons_differ_and_each_is_public():
    assert not set(evaluation_seeds(1000, "0")) & set(evaluation_seeds(1000, "1"))
    assert evaluation_seeds(3) == evaluation_seeds(1000)[:3]
    assert tuning_seeds(3) == tuning_seeds(1000)[:3]


def test_seeds_out_of_range_are_refused():
    for first, most in ((tuning_seeds, 2**40), (evaluation_seeds, 2**20)):
        for count in (-1, most + 1):
            with pytest.raises(UserError, match=f" {most}, asked for {count}"):
                first(count)
    for k in (-1, LAST_TRAINING + 1):
        with pytest.raises(UserError, match=f"training seed: expected 0 to {LAST_TRAINING},"):
            training_seed(k)


def test_data_sets_have_seeds_above_all_others():
    last_evaluation = 2**41 + 2**20 * 2**20
    assert last_evaluation <= dataset_seed(0) < dataset_seed(1) < dataset_seed(2**30 - 1) < 2**63
    assert dataset_seed(1) - dataset_seed(0) == 2**32
    for k in (-1, 2**30):
        with pytest.raises(UserError, match=f"seed of a data set: expected 0 to {2**30 - 1},"):
            dataset_seed(k)
