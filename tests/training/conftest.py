"""Trainings that are scored are scored on few rounds."""

from functools import partial

import pytest

from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from tests.training.tiny import EVALUATION_ROUNDS


@pytest.fixture(scope="module", autouse=True)
def few_rounds():
    with pytest.MonkeyPatch.context() as patched:
        evaluator = partial(PolicyEvaluator, rounds=EVALUATION_ROUNDS)
        patched.setattr("fpg_bench.training.train.PolicyEvaluator", evaluator)
        yield
