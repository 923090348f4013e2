"""Matches with a real server of a language model, and their replays without it."""

from __future__ import annotations

import json

import pytest

from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.servers import Endpoint, Server, load_server

from .playing import SHORT, assert_same, planner, play
from .real_server import LlamaServer

PROFILES = ("generic", "llama.cpp")  # free text, and an enforced schema


def profile_of(name: str) -> Server:
    """A profile with answers of a fit length: in free text the tests' model never comes to an end."""
    return load_server(name).model_copy(update={"max_tokens": 50 if name == "generic" else 4096})


@pytest.fixture(scope="module", params=PROFILES)
def match(request, tmp_path_factory, llama_server):
    """The profile, the transcript and the course of a match."""
    file = tmp_path_factory.mktemp(request.param) / "transcript.jsonl"
    where = Endpoint(llama_server.url, llama_server.model, server=profile_of(request.param))
    asking = LLMPlanner(SHORT, where, transcript=file)
    course = play(asking, rounds=2)
    asking.transcript.close()
    return request.param, file, course


@pytest.mark.slow
def test_free_text_of_a_random_model_is_no_path_and_with_a_schema_all_is_valid(match):
    profile, file, (plans, _) = match
    attempts = [json.loads(line) for line in file.read_text().splitlines()]
    expected = {"generic": "fallback-invalid", "llama.cpp": "ok"}[profile]
    assert [plan.status for plan in plans] == [expected] * 2
    assert {plan.source for plan in plans} == {"circle" if profile == "generic" else "llm"}
    assert len(attempts) == 2 * (2 if profile == "generic" else 1)
    assert {line["rung"] for line in attempts} == ({"none"} if profile == "generic" else {"json"})
    assert all(plan.tokens > 0 and plan.seconds > 0 for plan in plans)


def test_a_match_with_the_real_server_is_replayed_to_the_bit_and_recorded_again_without_it(match):
    profile, file, course = match
    assert_same(course, play(planner(transcript=file, mode="replay"), rounds=2))
    nowhere = Endpoint("http://127.0.0.1:9/v1", LlamaServer.model, server=profile_of(profile))
    assert_same(course, play(LLMPlanner(SHORT, nowhere, transcript=file), rounds=2))
