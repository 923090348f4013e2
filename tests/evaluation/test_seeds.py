import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import (
    EVALUATION_START,
    TUNING_START,
    evaluation_seeds,
    training_seed,
    tuning_seeds,
)


def test_ranges_never_meet():
    last_training = TUNING_START // 10**6 - 1
    assert training_seed(0) == 0
    assert training_seed(last_training) + 10**6 <= TUNING_START < EVALUATION_START
    for season in ("0", "1", "spring"):
        seeds = evaluation_seeds(1000, season)
        assert min(seeds) >= EVALUATION_START
        assert max(seeds) < 2**63


def test_seasons_differ_and_each_is_public():
    assert not set(evaluation_seeds(1000, "0")) & set(evaluation_seeds(1000, "1"))
    assert evaluation_seeds(3) == evaluation_seeds(1000)[:3]


@pytest.mark.parametrize("k", [-1, TUNING_START // 10**6])
def test_training_seed_out_of_range(k):
    with pytest.raises(UserError, match="training seed"):
        training_seed(k)


def test_tuning_seeds_lie_between_training_and_evaluation():
    assert tuning_seeds(3) == tuning_seeds(1000)[:3]
    last_training = training_seed(TUNING_START // 10**6 - 1) + 10**6 - 1
    assert last_training < min(tuning_seeds(1000)) <= max(tuning_seeds(1000)) < min(evaluation_seeds(1))
    for seeds, most in ((tuning_seeds, 2**41), (evaluation_seeds, 2**20 + 1)):
        with pytest.raises(UserError, match="asked for"):
            seeds(most)
