"""Planning beside the game: who flies what and when, what is dropped, how it ends, and its replay."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.players.planner import Plan
from fpg_bench.products.language_models.background import BackgroundPlanner
from fpg_bench.products.language_models.transcript import Transcript

from .fault_server import FaultServer, answer, ok
from .playing import BAD, ROUNDS, SHORT, path, path_text, planner, play, request


class Slow:
    """Plans when it is let: ``release`` lets it finish one batch and waits until it has."""

    name, tier, scenario, concurrency = "slow", "history", SHORT, 1

    def __init__(self, error=None):
        self.batches, self.error = [], error
        self.begun, self.go, self.done = (threading.Semaphore(0) for _ in range(3))
        self.transcript = Transcript()

    def plan_batch(self, requests):
        if self.batches:
            self.done.release()  # the batch before has been handed over
        self.batches.append([(r.game, r.seed, r.match, r.round) for r in requests])
        self.begun.release()
        assert self.go.acquire(timeout=30)
        if self.error is not None:
            raise self.error
        return [Plan(path(r.round), "slow") for r in requests]


def settle(beside):
    """Wait until the thread of a planner that waits for nothing has ended."""
    for thread in threading.enumerate():
        if thread.name == beside.name:
            thread.join(30)


def finish(beside, slow, batches=1):
    """Let the planner make so many batches, the last it has."""
    for _ in range(batches):
        slow.go.release()
    settle(beside)


def begin(slow):
    """Wait until the planner has begun with another batch."""
    assert slow.begun.acquire(timeout=30)


def origin(plan):
    return plan.source, plan.status


def test_the_plan_that_is_ready_is_flown_and_until_then_the_present_path():
    slow = Slow()
    beside = BackgroundPlanner(slow)
    (first,) = beside.plan_batch([request(0)])
    begin(slow)
    (second,) = beside.plan_batch([request(1)])
    assert origin(first) == origin(second) == ("circle", "held")
    assert np.array_equal(first.waypoints, second.waypoints)
    finish(beside, slow, 2)
    (third,) = beside.plan_batch([request(2)])
    assert origin(third) == ("slow", "ok")
    assert np.array_equal(third.waypoints, path(1))
    (fourth,) = beside.plan_batch([request(3)])
    assert origin(fourth) == ("held", "held")
    assert np.array_equal(fourth.waypoints, path(1))
    slow.go.release()


@pytest.mark.parametrize("concurrency", [1, 2])
def test_only_the_newest_request_of_a_game_waits_and_the_game_that_waited_longest_is_first(concurrency):
    slow = Slow()
    slow.concurrency = concurrency
    beside = BackgroundPlanner(slow)
    beside.plan_batch([request(0, game=0)])
    begin(slow)
    beside.plan_batch([request(0, game=1)])
    for index in (1, 2):
        beside.plan_batch([request(index, game=0), request(index, game=1)])
    finish(beside, slow, 3)
    first, *later = slow.batches
    assert first == [(0, 1, 0, 0)]
    assert [*itertools.chain(*later)] == [(1, 1, 0, 2), (0, 1, 0, 2)]
    assert len(later) == 2 // concurrency


@pytest.mark.parametrize("change", [{"match": 1}, {"seed": 2}])
def test_what_was_planned_for_a_match_that_has_ended_is_not_flown(change):
    slow = Slow()
    beside = BackgroundPlanner(slow)
    beside.plan_batch([request(0)])
    begin(slow)
    beside.plan_batch([request(1)])  # waits, and is dropped
    beside.plan_batch([request(0, **change)])
    finish(beside, slow, 2)
    asked = request(1, **change)
    (plan,) = beside.plan_batch([asked])
    assert origin(plan) == ("slow", "ok")
    assert np.array_equal(plan.waypoints, path(0))
    assert slow.batches == [[(0, 1, 0, 0)], [(0, asked.seed, asked.match, 0)]]
    slow.go.release()


@pytest.mark.parametrize("error", [UserError("no such thing"), OSError("disk full"), KeyError("a bug")])
def test_an_error_of_the_planner_comes_up_at_the_next_round(error):
    slow = Slow(error)
    beside = BackgroundPlanner(slow)
    beside.plan_batch([request(ROUNDS - 1)])  # nothing is asked for after a match's last round
    settle(beside)
    assert slow.batches == []
    beside.plan_batch([request(0)])
    finish(beside, slow)
    for _ in range(2):
        with pytest.raises(UserError, match="planner slow failed beside the game") as caught:
            beside.plan_batch([request(1)])
        assert str(error) in str(caught.value)


class Uneven:
    """Answers that come fast or slowly, good or bad, as a generator says."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def __call__(self, body):
        time.sleep(float(self.rng.choice([0.0, 0.02, 0.05])))
        return BAD if self.rng.random() < 0.4 else path_text(int(self.rng.integers(100)))


class Settled:
    """A planner beside the game that has always finished when a round starts, or only as often as said."""

    def __init__(self, beside, share=1.0):
        self.beside, self.share, self.rng = beside, share, np.random.default_rng(0)
        self.name, self.tier = beside.name, beside.tier

    def plan_batch(self, requests):
        time.sleep(0.01)
        if self.rng.random() < self.share:
            settle(self.beside)
        return self.beside.plan_batch(requests)


def flown(file):
    lines = map(json.loads, file.read_text().splitlines())
    return [line for line in lines if line["kind"] == "flown"]


def test_a_replay_flies_the_same_without_a_server_or_a_thread(tmp_path):
    file = tmp_path / "transcript.jsonl"
    with FaultServer([answer(Uneven(0))]) as server:
        beside = BackgroundPlanner(planner(server, transcript=file, concurrency=2))
        played = play(Settled(beside, 0.3), rounds=3 * ROUNDS, games=3)
        settle(beside)
    assert len(flown(file)) == 9 * ROUNDS
    before = file.read_bytes()
    again = BackgroundPlanner(planner(transcript=file, mode="replay"))
    threads = threading.active_count()
    replayed = play(again, rounds=3 * ROUNDS, games=3)
    assert threading.active_count() <= threads
    assert np.array_equal(played[1], replayed[1])
    for x, y in zip(played[0], replayed[0], strict=True):
        assert np.array_equal(x.waypoints, y.waypoints)
        assert (x.source, x.status, x.tokens) == (y.source, y.status, y.tokens)
    assert file.read_bytes() == before
    assert any(line["planned_round"] is not None for line in flown(file))


@pytest.fixture
def recorded(tmp_path):
    """A transcript in which round 0 flew the circle, and each round after it the plan of the one before."""
    file = tmp_path / "transcript.jsonl"
    with FaultServer([ok(path_text(index)) for index in range(ROUNDS)]) as server:
        beside = BackgroundPlanner(planner(server, transcript=file))
        played = play(Settled(beside))
    return file, played


def test_the_transcript_says_which_plan_each_round_flew(recorded):
    lines = list(map(json.loads, recorded[0].read_text().splitlines()))
    keys = [line["key"] for line in lines if line["kind"] == "attempt"]
    assert [line["plan"] for line in flown(recorded[0])] == ["circle", *keys]
    assert [line["planned_round"] for line in flown(recorded[0])] == [None, 0, 1, 2]
    assert len(keys) == ROUNDS - 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda lines: [x for x in lines if x.get("planned_round") != 1], "round 2 has no row"),
        (lambda lines: [x for x in lines if "key" not in x or x["round"] != 1], "round 2 flew .* not there"),
        (lambda lines: [{**x, "plan": "held"} if x["round"] == 0 else x for x in lines], "round 0 flew"),
        (
            lambda lines: [{**x, "text": path_text(50)} if "text" in x else x for x in lines],
            "round 0, attempt 0 is changed",
        ),
    ],
)
def test_a_replay_of_a_missing_or_changed_line_is_refused_by_name(recorded, change, named):
    file, _ = recorded
    lines = change([json.loads(line) for line in file.read_text().splitlines()])
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(UserError, match=f"seed 5, match 0, {named}"):
        play(BackgroundPlanner(planner(transcript=file, mode="replay")))


def test_a_run_that_was_stopped_flies_what_it_flew_and_goes_on(recorded):
    file, _ = recorded
    lines = file.read_bytes().splitlines(keepends=True)
    before = flown(file)[:2]
    stop = max(k for k, line in enumerate(lines) if json.loads(line).get("round") == 1)
    file.write_bytes(b"".join(lines[: stop + 1]) + lines[stop + 1][:-20])
    with FaultServer([ok(path_text(30 + index)) for index in range(ROUNDS)]) as server:
        played = play(Settled(BackgroundPlanner(planner(server, transcript=file))))
    assert flown(file)[:2] == before
    assert len(flown(file)) == ROUNDS
    assert np.array_equal(played[1], play(BackgroundPlanner(planner(transcript=file, mode="replay")))[1])


RUN = """
from tests.products.language_models.playing import SHORT, play
from fpg_bench.products.language_models.background import BackgroundPlanner
from fpg_bench.products.language_models.transcript import Transcript
from fpg_bench.products.language_models.llm_planner import LLMPlanner
play(BackgroundPlanner(LLMPlanner(SHORT)), rounds=1)
input()
"""


@pytest.mark.process
def test_a_program_ends_while_a_call_is_under_way(monkeypatch):
    asked, go = threading.Event(), threading.Event()

    def reply(body):
        asked.set()
        go.wait(60)
        return path_text()

    with FaultServer([answer(reply)]) as server:
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "tiny")
        pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen([sys.executable, "-c", RUN], **pipes, text=True) as run:
            assert asked.wait(60)
            _, errors = run.communicate("now end\n", timeout=30)  # the call would take twice as long
            go.set()
    assert (run.returncode, errors) == (0, "")
