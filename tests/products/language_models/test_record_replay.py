"""The LLM planner's transcript: a replay asks nobody, a record goes on and loses nothing."""

from __future__ import annotations

import json
import resource
import sys

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.llm_planner import LLMPlanner
from fpg_bench.products.language_models.prompts import load_prompt

from .fault_server import FaultServer, ok, refusal, status
from .playing import BAD, GOOD, SHORT, assert_same, endpoint, path_text, planner, play, request, statuses


@pytest.fixture
def recorded(tmp_path):
    """A transcript of a match with good, repaired, bad and no answers, and the match."""
    file = tmp_path / "transcript.jsonl"
    behaviours = [ok(BAD), ok(path_text(1)), ok(BAD), refusal(), status(400), ok(path_text(2) + "!")]
    with FaultServer(behaviours) as server:
        return file, play(planner(server, transcript=file))


def test_a_replay_is_identical_without_a_server_a_key_or_the_openai_package(recorded, monkeypatch):
    file, played = recorded
    assert statuses(played[0]) == ["reasked", "fallback-refused", "fallback-http", "ok"]
    before = file.read_bytes()
    monkeypatch.setitem(sys.modules, "openai", None)
    assert_same(played, play(planner(transcript=file, mode="replay")))
    assert file.read_bytes() == before
    with (
        FaultServer([GOOD]) as server,
        pytest.raises(UserError, match=r"is not installed: pip install .*\[llm\]"),
    ):
        planner(server)


def test_the_server_s_prompt_is_asked_with_and_a_replay_takes_the_transcript_s(tmp_path):
    file, profile = tmp_path / "transcript.jsonl", tmp_path / "mine.yml"
    profile.write_text("prompt: brief\nresponse_format: json_schema\n")
    with FaultServer([GOOD]) as server:
        asking = LLMPlanner(SHORT, endpoint(server, str(profile)), transcript=file)
        played = play(asking)
    assert asking.prompt == load_prompt("brief")
    assert_same(played, play(planner(transcript=file, mode="replay")))


def test_a_run_that_was_stopped_goes_on_and_calls_nothing_twice(recorded):
    file, (plans, states) = recorded
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:3]) + lines[3][:-20])
    with FaultServer([refusal(), status(400), ok(path_text(2) + "!")]) as server:
        again = play(planner(server, transcript=file))
        assert len(server.requests) == 3
    assert np.array_equal(again[1], states)
    assert statuses(again[0]) == statuses(plans)
    assert file.read_bytes().startswith(b"".join(lines[:3]))
    assert_same(again, play(planner(transcript=file, mode="replay")))


@pytest.mark.parametrize("options", [{"prompt": "paper"}, {"control": "no-history"}])
def test_a_replay_with_another_prompt_is_told_the_recorded_one(recorded, options):
    with pytest.raises(UserError, match="prompt 'standard', control 'none'"):
        play(planner(transcript=recorded[0], mode="replay", **options))


def test_a_full_disk_ends_the_run_and_loses_nothing(tmp_path):
    file, soft_hard = tmp_path / "transcript.jsonl", resource.getrlimit(resource.RLIMIT_FSIZE)
    with FaultServer([GOOD]) as server:
        asking = planner(server, transcript=file)
        asking.plan_batch([request(0)])
        kept = file.read_bytes()
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(kept) + 100, soft_hard[1]))
        try:
            with pytest.raises(OSError, match="too large"):
                asking.plan_batch([request(1)])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, soft_hard)
        assert file.read_bytes()[: len(kept)] == kept
        asking.plan_batch([request(1)])
    assert [json.loads(line)["round"] for line in file.read_text().splitlines()] == [0, 1]
