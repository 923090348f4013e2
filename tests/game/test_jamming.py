"""The type and centre that the opponent jams, and the band that this covers (Table 1, Eq. 7-10)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from .playing import NARROWBAND, ally, begin, opponent, still, to_point

POINT_MHZ = [150 + i * 100 / 14 for i in range(15)]


@pytest.mark.parametrize("point", range(2, 13))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_tolerance_takes_in_the_edge_itself(point, side):
    """An offset of exactly half a footprint from the known frequency: rounding must not decide."""
    batch = begin(still(tuning_span_mhz=10.0, first_check_s=(1, 1)))
    batch.step(ally(hop=True, preference=to_point(point)), opponent())
    batch.step(ally(), opponent(NARROWBAND, tuning=side))
    assert batch.games["jamming_mhz"][0] == pytest.approx(POINT_MHZ[point] + 10 * side)
    assert batch.games["covered"][0]


@given(
    scores=st.lists(st.sampled_from([-1.0, -0.5, 0.0, 0.25, 1.0, 3.0]), min_size=4, max_size=4),
    allowed=st.sets(st.integers(0, 3), min_size=1),
)
def test_the_largest_allowed_score_wins_ties_to_the_lowest(scores, allowed):
    names = ("tone", "narrowband", "broadband", "comb")
    batch = begin(still(jamming_types=tuple(names[i] for i in sorted(allowed))))
    action = opponent()
    action[0, :4] = scores
    batch.step(ally(), action)
    clipped = np.clip(scores, -1, 1)
    best = max(clipped[i] for i in allowed)
    assert batch.games["jamming_type"][0] == min(i for i in allowed if clipped[i] == best)
