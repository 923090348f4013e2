"""The budget: what a run may spend, and when a server that fails is left alone."""

from __future__ import annotations

import copy
import math

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.budget import CallBudget
from fpg_bench.products.language_models.transcript import Attempt

CALLED = Attempt(
    **dict.fromkeys(("seed", "match", "round", "attempt"), 0),
    **{"request": {}, "text": "text", "error": None, "detail": "", "waypoints": None, "rung": "none"},
    **{"status": "invalid", "prompt": "standard", "prompt_hash": "", "control": "none"},
    **{"calls": 1, "seconds": 2.0, "tokens_in": 30, "tokens_out": 20, "model": None},
)


def called(error=None, **changes):
    return CALLED.model_copy(update={"error": error, **changes})


@pytest.mark.parametrize(
    ("caps", "calls", "named"),
    [
        ({"calls": 3}, 3, "calls, 3,"),
        ({"tokens": 149}, 3, "tokens, 149,"),
        ({"tokens": 150}, 3, "tokens, 150,"),
        ({"seconds": 5.5}, 3, "seconds, 5.5,"),
        ({"calls": 1, "seconds": 5.5}, 1, "calls, 1,"),
    ],
)
def test_a_cap_that_is_reached_ends_the_calls(caps, calls, named):
    budget = CallBudget(**caps)
    for _ in range(calls):
        assert budget.refusal() is None
        budget.spend(CALLED)
    assert named in budget.refusal()


@pytest.mark.parametrize(
    ("caps", "attempt", "is_spent"),
    [
        ({"calls": 4}, called(calls=4), True),  # a call that was tried again
        ({"tokens": 1}, called(tokens_in=None, tokens_out=None), False),  # the server does not count
        ({"calls": 1, "tokens": 1, "seconds": 1}, called("budget"), False),  # no call was made
    ],
)
def test_what_a_call_took_counts(caps, attempt, is_spent):
    budget = CallBudget(**caps)
    budget.spend(attempt)
    assert (budget.refusal() is not None) == is_spent


@pytest.mark.parametrize("error", ["timeout", "http", "invalid"])
def test_five_failures_in_a_row_open_the_circuit_and_it_stays_open(error):
    budget = CallBudget()
    for _ in range(5):
        assert budget.refusal() is None
        budget.spend(called(error))
    assert "failed 5 times in a row" in budget.refusal()
    budget.spend(CALLED)  # it was under way
    assert budget.refusal() is not None


@pytest.mark.parametrize("error", [None, "refused"])
def test_an_answer_of_any_kind_closes_the_row(error):
    budget = CallBudget()
    for attempt in [*[called("http")] * 4, called(error), *[called("http")] * 4]:
        budget.spend(attempt)
    assert budget.refusal() is None


def test_what_was_spent_before_a_run_was_stopped_counts_once_and_its_failures_do_not():
    budget = CallBudget(calls=11)
    for _ in range(2):
        budget.resume([called("http")] * 5 + [called("budget")] * 5 + [CALLED] * 4 + [called("http")], "x")
    assert budget.refusal() is None
    budget.spend(called("http"))
    assert "calls, 11," in budget.refusal()


def test_plans_that_got_no_answer_are_told_once_where_a_run_goes_on(caplog):
    CallBudget().resume([CALLED, called("invalid"), called("refused")], "transcript x.jsonl")
    assert not caplog.messages
    budget, lost = CallBudget(), [called("http"), called("budget"), called("budget"), called("timeout")]
    for _ in range(2):
        budget.resume([CALLED, called("invalid"), *lost], "transcript x.jsonl")
    (message,) = caplog.messages
    assert message.startswith("transcript x.jsonl: plans without an answer: 4 (budget 2, http 1, timeout 1)")
    assert "another file or folder asks anew" in message


def test_copies_spend_from_one_budget():
    budget = CallBudget(calls=1)
    copy.deepcopy(budget).spend(CALLED)
    assert budget.refusal() is not None


@pytest.mark.parametrize("cap", [0, -1, math.nan, "many", None, True])
@pytest.mark.parametrize("name", ["calls", "tokens", "seconds"])
def test_a_cap_that_is_no_positive_number_is_refused(name, cap):
    with pytest.raises(UserError, match=f"budget: {name} is"):
        CallBudget(**{name: cap})
