"""The client with many questions at once, in threads, event loops and processes, copied and interrupted."""

from __future__ import annotations

import asyncio
import copy
import multiprocessing
import pickle
import signal
import subprocess
import sys
import threading
import time

import pytest

from . import fault_server as faults
from .asking import KEY, TALK, ask, client
from .fault_server import FaultServer, ok


@pytest.mark.parametrize("concurrency", [1, 4, 100])
def test_replies_come_in_the_order_of_the_questions(concurrency):
    with FaultServer([faults.answer(lambda body: f"seed {body['seed']}")]) as fake:
        asked = client(fake.url, "vllm")
        replies = asked.complete_all([asked.request_body(TALK, seed) for seed in range(9)], concurrency)
    assert [reply.text for reply in replies] == [f"seed {seed}" for seed in range(9)]
    assert asked.complete_all([]) == []


@pytest.mark.parametrize("concurrency", [1, 3])
def test_no_more_questions_are_under_way_than_allowed(concurrency):
    under_way, most, lock = 0, 0, threading.Lock()

    def slow(handler, body):
        nonlocal under_way, most
        with lock:
            under_way += 1
            most = max(most, under_way)
        handler.wait(0.02)
        with lock:
            under_way -= 1
        ok("Hello.")(handler, body)

    with FaultServer([slow]) as fake:
        asked = client(fake.url)
        asked.complete_all([asked.request_body(TALK, 0)] * 9, concurrency)
    assert most == concurrency


def test_each_reply_is_told_as_soon_as_it_is_there_and_trouble_with_it_goes_up():
    def disk_full(index, reply):
        raise OSError("no space left")

    slow_first = faults.answer(lambda body: time.sleep(0.3 * (body["seed"] == 0)) or str(body["seed"]))
    with FaultServer([slow_first]) as fake:
        asked, told = client(fake.url, "vllm"), []
        bodies = [asked.request_body(TALK, seed) for seed in range(3)]
        asked.complete_all(bodies, 3, lambda index, reply: told.append((index, reply.text)))
        with pytest.raises(OSError, match="no space left"):
            asked.complete_all(bodies, 1, disk_full)
    assert sorted(told) == [(0, "0"), (1, "1"), (2, "2")]
    assert told[-1] == (0, "0")


def test_it_works_beside_a_running_event_loop_in_threads_and_awaited():
    with FaultServer([ok("Hello.")]) as fake:
        asked = client(fake.url)
        body = asked.request_body(TALK, 0)

        async def notebook():
            return [*asked.complete_all([body]), await asked.complete(body)]

        replies = asyncio.run(notebook()) + asyncio.run(notebook())
        threads = [threading.Thread(target=lambda: replies.append(ask(asked))) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert [reply.text for reply in replies] == ["Hello."] * 8


def test_it_can_be_copied_and_pickled_after_use(monkeypatch):
    monkeypatch.setenv("FPG_LLM_API_KEY", "another-key")
    with FaultServer([ok("Hello.")]) as fake:
        asked = client(fake.url)
        ask(asked)
        assert KEY.encode() not in pickle.dumps(asked)
        for other in (copy.deepcopy(asked), pickle.loads(pickle.dumps(asked))):
            assert ask(other).text == "Hello."
    keys = [request.headers["authorization"].removeprefix("Bearer ") for request in fake.requests]
    assert keys == [KEY, KEY, "another-key"]


@pytest.mark.process
def test_it_works_in_a_forked_process():
    with FaultServer([ok("Hello.")]) as fake:
        asked = client(fake.url)
        ask(asked)
        context = multiprocessing.get_context("fork")
        theirs, ours = context.Pipe()
        process = context.Process(target=lambda: theirs.send(ask(asked).text), daemon=True)
        process.start()
        assert ours.poll(20)
        assert ours.recv() == "Hello."
        process.join()


SLOW_CALL = """
import sys
from fpg_bench.planning.llm.client import Client
from fpg_bench.planning.llm.servers import Endpoint
client = Client(Endpoint(sys.argv[1], "m"), 60)
bodies = [client.request_body([{"role": "user", "content": "hi"}], 0)] * 3
"""


@pytest.mark.process
def test_ctrl_c_ends_a_call_at_once():
    with FaultServer([faults.late(60, "late")]) as fake:
        code = SLOW_CALL + "client.complete_all(bodies)"
        # As in a terminal: a process that is started in the background may not hear the signal
        hear = lambda: signal.signal(signal.SIGINT, signal.default_int_handler)  # noqa: E731
        process = subprocess.Popen(
            [sys.executable, "-c", code, fake.url], stderr=subprocess.PIPE, text=True, preexec_fn=hear
        )
        wait_for(lambda: fake.requests)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert "KeyboardInterrupt" in errors
    assert len(fake.requests) == 1


@pytest.mark.process
def test_a_process_ends_while_a_call_is_under_way():
    with FaultServer([faults.late(60, "late")]) as fake:
        code = (
            SLOW_CALL
            + "import threading\nthreading.Thread(target=client.complete_all, args=[bodies], daemon=True)"
        )
        code += ".start()\nsys.stdin.readline()"
        process = subprocess.Popen([sys.executable, "-c", code, fake.url], stdin=subprocess.PIPE, text=True)
        wait_for(lambda: fake.requests)
        process.communicate("go\n", timeout=20)
    assert process.returncode == 0


def wait_for(condition):
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)
