"""A command that is killed and run again gives the same result as an uninterrupted one."""

import pytest

from tests.attacks import SCALE, SEED
from tests.attacks.kills import VERBS, Killed

pytestmark = pytest.mark.process


@pytest.mark.parametrize(
    "verb", ["match", pytest.param("selfplay", marks=pytest.mark.slow)] if SCALE == 1 else VERBS
)
def test_a_killed_command_resumes_to_the_same_result(verb, tmp_path):
    killed = Killed(verb, tmp_path)
    for seed in range(SEED, SEED + SCALE):
        assert killed.same(tmp_path / f"killed-{seed}", seed=seed)
