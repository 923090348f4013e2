"""The LLM planner: what it asks and does with the answers, what it spends, copies and hides."""

from __future__ import annotations

import copy
import json
import pickle
import threading

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.checkers import check_planner
from fpg_bench.products.language_models.llm_planner import server_seed

from .fault_server import (
    FaultServer,
    answer,
    close_socket,
    cut_json,
    error_object,
    html,
    late,
    ok,
    refusal,
    status,
    trickle,
)
from .playing import (
    BAD,
    GOOD,
    KEY,
    ROUNDS,
    SHORT,
    assert_same,
    path,
    path_text,
    planner,
    play,
    request,
    statuses,
)


def asked(server):
    """The texts of the last messages that a server was sent."""
    return [received.body["messages"][-1]["content"] for received in server.requests]


def test_a_valid_answer_is_flown():
    with FaultServer([ok(path_text(7))]) as server:
        (plan,) = planner(server).plan_batch([request()])
    assert np.array_equal(plan.waypoints, path(7))
    assert (plan.source, plan.status, plan.tokens, plan.useless) == ("llm", "ok", 18, "")
    assert plan.seconds > 0


@pytest.mark.parametrize(
    ("behaviours", "calls", "expected"),
    [
        ([ok(BAD)], 2, "fallback-invalid"),
        ([ok("\ud800")], 2, "fallback-invalid"),
        ([cut_json()], 1, "fallback-invalid"),
        ([ok("I'm sorry, I can't help with that.")], 2, "fallback-refused"),
        ([refusal()], 1, "fallback-refused"),
        ([status(500)], 3, "fallback-http"),
        ([ok(BAD), status(500)], 4, "fallback-http"),
        ([close_socket(30)], 3, "fallback-http"),
        ([late(60, path_text())], 1, "fallback-timeout"),
        ([trickle(60, path_text())], 1, "fallback-timeout"),
    ],
)
def test_without_a_valid_answer_the_circle_is_flown_and_the_status_says_why(
    tmp_path, behaviours, calls, expected
):
    deadline, file = 0.3 if expected == "fallback-timeout" else 30.0, tmp_path / "transcript.jsonl"
    with FaultServer(behaviours) as server:
        (plan,) = planner(server, deadline_s=deadline, transcript=file).plan_batch([request()])
        assert len(server.requests) == calls
    assert (plan.source, plan.status) == ("circle", expected)
    centre = np.array(SHORT.patrol_centre_m)
    assert np.linalg.norm((plan.waypoints - centre)[:, :2], axis=1) == pytest.approx(np.full(16, 300.0))
    (again,) = planner(transcript=file, mode="replay").plan_batch([request()])
    assert (again.source, again.status, again.tokens) == (plan.source, plan.status, plan.tokens)


@pytest.mark.parametrize("mode", ["live", "record"])
def test_the_last_valid_path_is_held_in_its_match_alone(tmp_path, mode):
    file = tmp_path / "transcript.jsonl" if mode == "record" else None
    with FaultServer([GOOD, ok(path_text(5)), ok(BAD)]) as server:
        asking = planner(server, transcript=file)
        asking.plan_batch([request(0), request(1)])
        here, later, other_seed, other_match = asking.plan_batch(
            [request(2), request(3), request(2, seed=2), request(2, match=1)]
        )
        (again,) = asking.plan_batch([request(0)])  # the match is played again
    assert here.source == later.source == "held"
    assert np.array_equal(here.waypoints, path(5))
    assert np.array_equal(later.waypoints, path(5))
    assert {other_match.source, other_seed.source} == {"circle"}
    assert again.source == ("circle" if mode == "live" else "llm")


def test_a_seed_for_the_server_is_its_attempt_s_own_and_fits_31_bits():
    wheres = [(s, m, r, a) for s in (0, 2**62) for m in (0, 1) for r in range(10) for a in (0, 1)]
    seeds = [server_seed(where) for where in wheres]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert server_seed((5, 0, 0, 0)) == 1237686955  # transcripts of other versions hold it


def test_it_keeps_to_the_contract_of_planners():
    for behaviour in (GOOD, ok(BAD)):
        with FaultServer([behaviour]) as server:
            check_planner(planner(server), SHORT)


def test_plans_do_not_depend_on_how_many_games_are_asked_for_at_once(tmp_path):
    def reply(body):  # a path, or none, that depends on what is asked
        shift = sum(map(ord, json.dumps(body["messages"]))) % 50
        return BAD if shift % 3 == 0 else path_text(shift)

    with FaultServer([answer(reply)]) as server:
        first = play(planner(server, transcript=tmp_path / "1.jsonl"), games=5)
        second = play(planner(server, transcript=tmp_path / "n.jsonl", concurrency=2), games=5)
    again = play(planner(transcript=tmp_path / "n.jsonl", mode="replay"), games=5)
    assert_same(second, again)
    assert np.array_equal(first[1], second[1])
    assert statuses(first[0]) == statuses(second[0])
    assert {"ok", "reasked", "fallback-invalid"} & set(statuses(first[0])) > {"ok"}


@pytest.mark.parametrize("cap", [{"calls": 2}, {"tokens": 36}, {"tokens": 19}])
def test_a_spent_budget_ends_the_calls_and_the_path_is_held(tmp_path, caplog, cap):
    file = tmp_path / "transcript.jsonl"
    with FaultServer([ok(path_text(1)), ok(path_text(2))]) as server:
        played = play(planner(server, transcript=file, **cap))
        assert len(server.requests) == 2
    assert statuses(played[0]) == ["ok", "ok", "fallback-budget", "fallback-budget"]
    assert np.array_equal(played[0][-1].waypoints, path(2))
    assert (played[0][-1].source, played[0][-1].tokens) == ("held", 0)
    assert len(caplog.records) == 1
    assert_same(played, play(planner(transcript=file, mode="replay")))


@pytest.mark.parametrize(("concurrency", "failures"), [(1, 5), (3, 6)])
def test_after_five_failures_in_a_row_the_server_is_left_alone(tmp_path, concurrency, failures):
    file = tmp_path / "transcript.jsonl"
    failing = [status(400), status(404), status(401), error_object(), html(), cut_json()]
    with FaultServer([*[GOOD] * 3, *failing[:failures], GOOD]) as server:
        played = play(planner(server, transcript=file, concurrency=concurrency), games=3)
        assert len(server.requests) == 3 + failures
    results = statuses(played[0])
    assert results[:3] == ["ok"] * 3
    assert set(results[3 : 3 + failures]) == {"fallback-http", "fallback-invalid"}
    assert results[3 + failures :] == ["fallback-budget"] * (9 - failures)
    assert_same(played, play(planner(transcript=file, mode="replay"), games=3))


HOPELESS = {
    "the key is refused": (
        status(401, body={"error": {"message": f"no such key: {KEY}"}}),
        "FPG_LLM_API_KEY",
    ),
    "no access": (status(403), "HTTP 403"),
    "no such address": (status(404), "FPG_LLM_BASE_URL"),
    "a web page": (html(), "a web page"),
    "nobody listens": (None, "ConnectError"),
}


@pytest.mark.parametrize(
    ("name", "concurrency"), [*[(name, 1) for name in HOPELESS], ("the key is refused", 3)]
)
def test_what_asking_again_cannot_mend_ends_the_run_and_is_not_kept(tmp_path, name, concurrency):
    behaviour, why = HOPELESS[name]
    file, requests = tmp_path / "transcript.jsonl", [request(seed=seed) for seed in range(6)]
    with FaultServer([behaviour or GOOD]) as server:
        if behaviour is None:
            server.__exit__()
        asking = planner(server, transcript=file, concurrency=concurrency)
        with pytest.raises(UserError, match="mend the server or the FPG_LLM_ variables") as caught:
            asking.plan_batch(requests)
        assert len(server.requests) <= concurrency
        asking.transcript.close()
    assert str(caught.value).startswith("planner llm: ")
    assert why in str(caught.value)
    assert KEY not in str(caught.value)
    assert not file.exists()
    with FaultServer([GOOD]) as server:
        plans = planner(server, transcript=file).plan_batch(requests)
    assert statuses(plans) == ["ok"] * 6


def test_after_a_first_answer_the_same_is_a_status():
    with FaultServer([GOOD, HOPELESS["a web page"][0]]) as server:
        plans, _ = play(planner(server))
    assert [plan.status.split("-")[0] for plan in plans] == ["ok"] + ["fallback"] * (ROUNDS - 1)


def test_one_answer_among_calls_under_way_is_enough(tmp_path):
    together, numbers = threading.Barrier(3, timeout=10), iter(range(3))

    def play_it(handler, body):
        together.wait()
        (status(401) if next(numbers) else late(0.2, path_text()))(handler, body)

    with FaultServer([play_it]) as server:
        asking = planner(server, transcript=tmp_path / "transcript.jsonl", concurrency=3)
        plans = asking.plan_batch([request(seed=seed) for seed in range(3)])
    assert sorted(statuses(plans)) == ["fallback-http", "fallback-http", "ok"]
    assert len(asking.transcript.attempts()) == 3


def test_a_copy_goes_on_by_itself(tmp_path):
    with FaultServer([GOOD, ok(BAD)]) as server:
        asking = planner(server)
        asking.plan_batch([request(0)])
        twin = copy.deepcopy(asking)
        asking.plan_batch([request(0, match=1)])
        assert np.array_equal(twin.plan_batch([request(1)])[0].waypoints, path())
        assert server.requests[-1].headers["authorization"] == f"Bearer {KEY}"


def test_a_pickle_holds_no_key_and_finds_it_in_the_environment(monkeypatch):
    with FaultServer([GOOD]) as server:
        asking = planner(server)
        asking.plan_batch([request(0)])
        data = pickle.dumps(asking)
        monkeypatch.setenv("FPG_LLM_API_KEY", "another-key")
        (plan,) = pickle.loads(data).plan_batch([request(1)])
        assert server.requests[-1].headers["authorization"] == "Bearer another-key"
    assert plan.status == "ok"
    assert KEY.encode() not in data


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prompt": "standrad"}, "did you mean 'standard'"),
        ({"control": "shuffled"}, "did you mean 'shuffled-rewards'"),
        ({"mode": "again"}, "choose one of live, record, replay"),
        ({"calls": 0}, "calls is 0"),
        ({"concurrency": 0}, "concurrency is 0"),
        *[({"deadline_s": value}, "deadline: .*above 0") for value in (0, -1, float("nan"), float("inf"))],
    ],
)
def test_an_option_that_cannot_be_is_refused(options, message):
    with FaultServer([GOOD]) as server, pytest.raises(UserError, match=message):
        planner(server, **options)
