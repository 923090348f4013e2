import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.leaderboard.ranking import nash


def test_rock_paper_scissors_is_played_evenly():
    found = nash(np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]], float))
    assert found.rows == pytest.approx([1 / 3] * 3)
    assert found.columns == pytest.approx([1 / 3] * 3)
    assert found.value == pytest.approx(0)


def test_who_loses_less_against_everybody_is_played_alone():
    found = nash(np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.9]]))
    assert (found.rows.tolist(), found.columns.tolist()) == ([1, 0, 0], [0, 1])
    assert found.value == pytest.approx(0.2)


@pytest.mark.parametrize(("seed", "shape"), [(0, (7, 4)), (1, (1, 9)), (2, (20, 31)), (3, (5, 1))])
def test_nobody_gains_by_leaving(seed, shape):
    losses = np.random.default_rng(seed).uniform(size=shape)
    found = nash(losses)
    assert found.rows.sum() == pytest.approx(1)
    assert found.columns.sum() == pytest.approx(1)
    assert min(found.rows.min(), found.columns.min()) >= 0
    gap = (found.rows @ losses).max() - (losses @ found.columns).min()
    assert gap == pytest.approx(0, abs=1e-9)
    assert found.value == pytest.approx((found.rows @ losses).max())


@pytest.mark.parametrize("losses", [np.zeros((0, 3)), np.array([[0.1, np.nan]]), np.zeros(3)])
def test_no_matrix_is_one_line(losses):
    with pytest.raises(UserError, match="meta-game: expected a matrix of finite numbers"):
        nash(losses)
