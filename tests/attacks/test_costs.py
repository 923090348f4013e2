"""What a row costs is counted in every batch, and nothing hides from the count."""

import pytest

from fpg_bench.players.sandbox.client import check_policies, check_policy
from tests.attacks.costly import costly, unsized

POLICIES = costly()


@pytest.fixture(scope="module")
def found():
    return dict(zip(POLICIES, check_policies(list(POLICIES.values())), strict=True))


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_that_costs_too_much_is_told(name, found):
    (record,) = found[name]
    assert "multiply-adds a row, at most 2,000,000 are allowed" in record


@pytest.mark.parametrize("name", unsized())
def test_a_size_that_does_not_follow_exactly_is_refused(name):
    assert check_policy(unsized()[name])
