"""Matches with a real server of a language model, and with one that plays faults of every kind."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fpg_bench.envs.two_player import make_duel
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.servers import Endpoint, Server, load_server

from .fault_server import (
    FaultServer,
    close_socket,
    cut_json,
    html,
    late,
    ok,
    refusal,
    reject_field,
    status,
    think,
    trickle,
)
from .playing import LIMITS, ROUNDS, SHORT, assert_same, endpoint, path, path_text, planner, play, request
from .real_server import LlamaServer

# The real server

PROFILES = ("generic", "llama.cpp")  # free text, and an enforced schema


def profile_of(name: str) -> Server:
    """A profile with answers of a fit length: in free text the tests' model never comes to an end."""
    return load_server(name).model_copy(update={"max_tokens": 50 if name == "generic" else 4096})


@pytest.fixture(scope="module", params=PROFILES)
def match(request, tmp_path_factory):
    """The profile, the transcript and the course of a match; its server is gone."""
    file = tmp_path_factory.mktemp(request.param) / "transcript.jsonl"
    with LlamaServer() as server:
        where = Endpoint(server.url, server.model, server=profile_of(request.param))
        asking = LLMPlanner(SHORT, where, transcript=file)
        course = play(asking, games=2)
        asking.transcript.close()
    return request.param, file, course


@pytest.mark.slow
def test_free_text_of_a_random_model_is_no_path_and_with_a_schema_all_is_valid(match):
    profile, file, (plans, _) = match
    attempts = [json.loads(line) for line in file.read_text().splitlines()]
    expected = {"generic": "fallback-invalid", "llama.cpp": "ok"}[profile]
    assert [plan.status for plan in plans] == [expected] * 2 * ROUNDS
    assert {plan.source for plan in plans} == {"circle" if profile == "generic" else "llm"}
    assert len(attempts) == 2 * ROUNDS * (2 if profile == "generic" else 1)
    assert {line["rung"] for line in attempts} == ({"none"} if profile == "generic" else {"json"})
    assert all(plan.tokens > 0 and plan.seconds > 0 for plan in plans)


def test_a_match_with_the_real_server_is_replayed_to_the_bit_when_it_is_gone(match):
    _, file, course = match
    assert_same(course, play(planner(transcript=file, mode="replay"), games=2))


def test_a_recorded_match_needs_no_server_either(match):
    profile, file, course = match
    nowhere = Endpoint("http://127.0.0.1:9/v1", LlamaServer.model, server=profile_of(profile))
    assert_same(course, play(LLMPlanner(SHORT, nowhere, transcript=file), games=2))


def test_the_opponent_flies_to_where_the_model_sends_it(llama_server):
    where = Endpoint(llama_server.url, llama_server.model, server=profile_of("llama.cpp"))
    duel = make_duel(scenario=SHORT, planner=LLMPlanner(SHORT, where))
    duel.reset(seeds=5)
    position = duel.batch.games["opponent_position"][0]
    before = np.linalg.norm(duel.plans[0].waypoints[0] - position)
    for _ in range(2):
        duel.step(np.zeros((1, 9)), np.zeros((1, 9)))
    after = np.linalg.norm(duel.plans[0].waypoints[0] - position)
    assert before - after == pytest.approx(min(before, 2 * LIMITS.speed_m_s), abs=1e-6)


# Every fault

POINTS = path().astype(int).tolist()


def listed(points) -> str:
    return f"Next directions: {json.dumps(points)}"


def with_first(*point) -> str:
    first = ", ".join(map(str, point))
    return f"Next directions: [[{first}], {json.dumps(POINTS[1:])[1:]}"


GOOD_ONES = {
    "schema's object": (ok(path_text()), "ok"),
    "the paper's form": (ok(listed(POINTS)), "ok"),
    "a think block first": (think(path_text()), "ok"),
    "too many points": (ok(listed([*POINTS, [1, 2, 3]])), "repaired"),
    "429, then an answer": ([status(429, {"Retry-After": "0"}), ok(path_text())], "ok"),
    "response_format breaks it": (reject_field("response_format", path_text(), 500), "ok"),
}


@pytest.mark.parametrize("name", GOOD_ONES)
def test_what_can_be_read_is_flown(name):
    behaviours, expected = GOOD_ONES[name]
    with FaultServer(behaviours if isinstance(behaviours, list) else [behaviours]) as server:
        (plan,) = LLMPlanner(SHORT, endpoint(server, "llama.cpp")).plan_batch([request()])
    assert (plan.source, plan.status) == ("llm", expected)
    assert np.array_equal(plan.waypoints, path())


# What the server does, and whether it is asked a second time for one plan
BAD_ONES = {
    "401": (status(401), "http", 1),
    "500": (status(500), "http", 3),
    "a closed socket": (close_socket(), "http", 3),
    "a socket closed in the answer": (close_socket(30), "http", 3),
    "HTML in a 200": (html(), "invalid", 1),
    "cut JSON": (cut_json(), "invalid", 1),
    "silence": (late(60, path_text()), "timeout", 1),
    "trickling bytes": (trickle(60, path_text()), "timeout", 1),
    "a refusal in its field": (refusal(), "refused", 1),
    "a refusal in words": (ok("I'm sorry, but I can't help with that."), "refused", 2),
    "words": (ok("North, then east."), "invalid", 2),
    "too few points": (ok(listed(POINTS[:15])), "invalid", 2),
    "NaN": (ok(with_first("NaN", 200, 150)), "invalid", 2),
    "5000 digits": (ok(with_first("7" * 5000, 200, 150)), "invalid", 2),
    "a path in a thought alone": (ok(f"<think>{path_text()}</think>I do not know."), "invalid", 2),
    "half a surrogate pair": (ok("\ud800"), "invalid", 2),
}


@pytest.mark.parametrize("name", BAD_ONES)
def test_what_cannot_be_read_is_told_and_the_last_valid_path_held(tmp_path, name):
    behaviour, why, calls = BAD_ONES[name]
    file, quick = tmp_path / "transcript.jsonl", {"deadline_s": 0.5} if why == "timeout" else {}
    with FaultServer([ok(path_text()), behaviour]) as server:
        course = play(planner(server, transcript=file, **quick), rounds=2)
        assert len(server.requests) == 1 + calls
    plans, _ = course
    assert [(plan.source, plan.status) for plan in plans] == [("llm", "ok"), ("held", f"fallback-{why}")]
    assert np.array_equal(plans[1].waypoints, path())
    assert_same(course, play(planner(transcript=file, mode="replay"), rounds=2))
