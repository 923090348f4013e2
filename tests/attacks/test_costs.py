"""What a row costs is counted in every batch, and nothing hides from the count."""

from fpg_bench.players.sandbox.client import check_policies
from tests.attacks.costly import costly, unsized


def test_a_policy_that_costs_too_much_is_refused():
    policies = costly()
    for name, lines in zip(policies, check_policies(list(policies.values())), strict=True):
        (line,) = lines
        assert "multiply-adds a row, at most 2,000,000 are allowed" in line, name


def test_a_size_that_does_not_follow_exactly_is_refused():
    assert all(check_policies(list(unsized().values())))
