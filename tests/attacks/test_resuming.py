"""A verb that is killed on its way, and run again, comes to what an uninterrupted run does."""

import pytest

from tests.attacks.kills import Killed

pytestmark = pytest.mark.process


def test_a_killed_match_goes_on_to_the_same_result(tmp_path):
    killed = Killed("match", tmp_path)
    assert killed.same(tmp_path / "killed", seed=0)
