"""The LLM planner before a server that is of no use: the run ends, says why and burns nothing."""

from __future__ import annotations

import threading

import pytest

from fpg_bench.common.errors import UserError

from .fault_server import FaultServer, html, late, status
from .playing import GOOD, KEY, ROUNDS, path_text, planner, play, request, statuses

HOPELESS = {
    "the key is refused": (
        status(401, body={"error": {"message": f"no such key: {KEY}"}}),
        "FPG_LLM_API_KEY",
    ),
    "no access": (status(403), "HTTP 403"),
    "no such address": (status(404), "FPG_LLM_BASE_URL"),
    "another kind of address": (status(405), "HTTP 405"),
    "moved": (status(301, {"Location": "https://example.invalid/v1"}), "HTTP 301"),
    "a web page": (html(), "a web page"),
    "nobody listens": (None, "ConnectError"),
}


@pytest.mark.parametrize("concurrency", [1, 3])
@pytest.mark.parametrize("name", HOPELESS)
def test_what_asking_again_cannot_mend_ends_the_run_and_is_not_kept(tmp_path, name, concurrency):
    behaviour, why = HOPELESS[name]
    file, requests = tmp_path / "transcript.jsonl", [request(seed=seed) for seed in range(6)]
    with FaultServer([behaviour or GOOD]) as server:
        if behaviour is None:
            server.__exit__()
        asking = planner(server, transcript=file, concurrency=concurrency)
        with pytest.raises(UserError, match="fpg-bench plan probe") as caught:
            asking.plan_batch(requests)
        assert len(server.requests) <= concurrency
        asking.transcript.close()
    assert str(caught.value).startswith("planner llm: ")
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)
    assert KEY not in str(caught.value)
    assert file.read_text() == ""
    with FaultServer([GOOD]) as server:
        plans = planner(server, transcript=file).plan_batch(requests)
    assert statuses(plans) == ["ok"] * 6


@pytest.mark.parametrize("name", ["the key is refused", "a web page"])
def test_after_a_first_answer_the_same_is_a_status(name):
    with FaultServer([GOOD, HOPELESS[name][0]]) as server:
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
