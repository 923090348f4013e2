"""What a row costs is counted in every batch, and nothing hides from the count."""

import pytest

from fpg_bench.leaderboard.policy_client import check_policies
from tests.attacks.costly import costly

POLICIES = costly()


@pytest.fixture(scope="module")
def found():
    return dict(zip(POLICIES, check_policies(list(POLICIES.values())), strict=True))


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_that_costs_too_much_is_told(name, found):
    (record,) = found[name]
    assert "multiply-adds a row, at most 2,000,000 are allowed" in record
