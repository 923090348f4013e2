"""A study that is interrupted at any moment ends at once, and gives back each trial that it had begun."""

import pytest

from tests.attacks import SCALE, SEED
from tests.attacks.interrupts import InterruptedStudy, busy

CASES = 2


@pytest.mark.slow
@pytest.mark.process
def test_an_interrupted_study_gives_back_its_trials(tmp_path):
    study = InterruptedStudy(tmp_path)
    with busy():
        assert not [problem for seed in range(SEED, SEED + CASES * SCALE) for problem in study.problems(seed)]
