"""The LLM planner's transcript: a replay asks nobody, a record goes on and loses nothing."""

from __future__ import annotations

import itertools
import json
import resource
import signal
import subprocess
import sys
import threading

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.prompts import load_prompt

from .fault_server import FaultServer, answer, ok, refusal, status
from .playing import (
    BAD,
    GOOD,
    SHORT,
    assert_same,
    endpoint,
    path,
    path_text,
    planner,
    play,
    request,
    statuses,
)


@pytest.fixture
def recorded(tmp_path):
    """A transcript of a match with good, repaired, bad and no answers, and the match."""
    file = tmp_path / "transcript.jsonl"
    behaviours = [ok(BAD), ok(path_text(1)), ok(BAD), refusal(), status(400), ok(path_text(2) + "!")]
    with FaultServer(behaviours) as server:
        return file, play(planner(server, transcript=file))


def test_a_replay_is_identical_without_a_server_or_a_key(recorded):
    file, played = recorded
    assert statuses(played[0]) == ["reasked", "fallback-refused", "fallback-http", "ok"]
    before = file.read_bytes()
    assert_same(played, play(planner(transcript=file, mode="replay")))
    assert file.read_bytes() == before


def test_a_replay_needs_no_openai_package(recorded, monkeypatch):
    monkeypatch.setitem(sys.modules, "openai", None)
    assert_same(recorded[1], play(planner(transcript=recorded[0], mode="replay")))
    with FaultServer([GOOD]) as server, pytest.raises(UserError, match=r'pip install "fpg-bench\[llm\]"'):
        planner(server)


def test_the_server_s_prompt_is_asked_with_and_a_replay_takes_the_transcript_s(tmp_path):
    file = tmp_path / "transcript.jsonl"
    with FaultServer([GOOD]) as server:
        asking = LLMPlanner(SHORT, endpoint(server, "embedded"), transcript=file)
        played = play(asking)
    assert asking.prompt == load_prompt("brief")
    assert_same(played, play(planner(transcript=file, mode="replay")))


def test_a_recorded_match_calls_nothing_again(recorded):
    file, played = recorded
    with FaultServer([GOOD]) as server:
        assert_same(played, play(planner(server, transcript=file)))
        assert not server.requests


def changed_lines(lines, change):
    rows = [json.loads(line) for line in lines]
    change(rows)
    return "".join(json.dumps(row) + "\n" for row in rows)


def set_field(index, name, value):
    return lambda rows: rows[index].update({name: value})


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda rows: rows.pop(0), "round 0, attempt 0 is missing"),
        (lambda rows: rows.pop(1), "round 0, attempt 1 is missing"),
        (lambda rows: rows.pop(5), "round 3, attempt 0 is missing"),
        (set_field(1, "text", path_text(1).replace("201", "202")), "round 0, attempt 1 is changed"),
        (set_field(0, "text", path_text()), "round 0, attempt 0 is changed"),
        (set_field(0, "text", "Next directions: [[1, 2, 3]]"), "round 0, attempt 0 is changed"),
        (set_field(1, "waypoints", path(9).tolist()), "round 0, attempt 1 is changed"),
        (set_field(1, "status", "repaired"), "round 0, attempt 1 is changed"),
        (set_field(4, "error", "timeout"), "round 2, attempt 0 is changed"),
        (set_field(5, "request", {"messages": []}), "round 3, attempt 0 was recorded with other messages"),
    ],
)
def test_a_replay_of_a_missing_or_changed_entry_is_refused_by_name(recorded, change, named):
    file, _ = recorded
    file.write_text(changed_lines(file.read_text().splitlines(), change))
    with pytest.raises(UserError, match=f"seed 5, match 0, {named}"):
        play(planner(transcript=file, mode="replay"))


@pytest.mark.parametrize("options", [{"prompt": "paper"}, {"control": "no-history"}])
def test_a_replay_with_another_prompt_is_told_the_recorded_one(recorded, options):
    with pytest.raises(UserError, match="prompt 'standard', control 'none'"):
        play(planner(transcript=recorded[0], mode="replay", **options))


RUN = """
import sys
from tests.planning.llm.playing import SHORT, play
from fpg_bench.planning.llm.llm_planner import LLMPlanner
play(LLMPlanner(SHORT, transcript=sys.argv[1], concurrency=int(sys.argv[2])), games=int(sys.argv[2]))
"""


@pytest.mark.process
def test_a_killed_run_goes_on_and_calls_nothing_twice(tmp_path, monkeypatch):
    games = 3
    file, reached, go = tmp_path / "transcript.jsonl", threading.Event(), threading.Event()
    numbers, killed = itertools.count(), []

    def reply(body):
        number = next(numbers)
        if number == 3 * games - 1:  # all others that are under way are answered and kept, this one is not
            killed.append(body)
            while len(file.read_text().splitlines()) < number:
                go.wait(0.01)
            reached.set()
            go.wait(60)
        return path_text(len(json.dumps(body)) % 40)

    with FaultServer([answer(reply)]) as server:
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "tiny")
        command = [sys.executable, "-c", RUN, str(file), str(games)]
        with subprocess.Popen(command) as run:
            assert reached.wait(60)
            run.send_signal(signal.SIGKILL)
        go.set()
        answered = [received.body for received in server.requests if received.body not in killed]
        lines = file.read_bytes()
        play(LLMPlanner(SHORT, transcript=file, concurrency=games), games=games)
        later = [received.body for received in server.requests[len(answered) + 1 :]]
    assert killed[0] in later
    assert not [body for body in later if body in answered]
    assert file.read_bytes().startswith(lines)
    attempts = [json.loads(line) for line in file.read_text().splitlines()]
    assert len(attempts) == len(answered) + len(later)
    play(planner(transcript=file, mode="replay"), games=games)


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
