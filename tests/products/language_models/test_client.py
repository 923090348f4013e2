"""The client: what it sends, its replies to every fault, its deadline, concurrency, and the key's safety."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import threading

import pytest

from fpg_bench.products.language_models.client import BACKOFF_S, LONGEST_BODY, RETRIES, Client, read_reply
from fpg_bench.products.language_models.servers import Endpoint

from . import fault_server as faults
from .fault_server import MODEL, FaultServer, completion, ok
from .playing import CHAT, KEY, SCHEMA, ask, client

SPARK_CODES = (10013, 10014, 10019)
TRIED_AGAIN = 1 + RETRIES


def reply_to(*behaviours, **options):
    """The reply of a server that behaves so, and the number of requests that it saw."""
    with FaultServer(behaviours) as server:
        return ask(client(server.url, **options)), len(server.requests)


def read(body, status=200, codes=("content_filter", *SPARK_CODES)):
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    return read_reply(status, data, KEY, codes)


def choice(**message):
    return [{"index": 0, "message": {"role": "assistant", **message}}]


@pytest.mark.parametrize(
    ("server", "fields"),
    [
        ("generic", {"max_tokens"}),
        ("spark", {"max_tokens"}),
        ("transformers-serve", {"max_tokens", "seed"}),
        ("llama.cpp", {"max_tokens", "seed", "response_format"}),
        ("openai", {"max_completion_tokens", "seed", "response_format"}),
    ],
)
def test_a_request_holds_what_the_profile_says_and_no_more(server, fields):
    with FaultServer([ok("Hello.")]) as fake:
        reply = ask(client(fake.url, server))
    (request,) = fake.requests
    assert request.path == "/v1/chat/completions"
    assert set(request.body) == {"model", "messages", "temperature", *fields}
    assert request.body == reply.sent
    assert request.body["messages"] == CHAT
    assert request.body.get("seed", 7) == 7


def test_the_schema_is_sent_in_the_form_that_the_profile_says():
    def form(response_format):
        asked = client("http://127.0.0.1:1", response_format=response_format)
        return asked.request_body(CHAT, 0, SCHEMA).get("response_format")

    assert form("none") is None
    assert form("json_object") == {"type": "json_object"}
    assert form("json_object_with_schema") == {"type": "json_object", "schema": SCHEMA}
    assert form("json_schema")["json_schema"]["schema"] == SCHEMA
    assert "response_format" not in client("http://127.0.0.1:1", "vllm").request_body(CHAT, 0)


def test_nothing_of_the_environment_or_the_machine_is_sent(monkeypatch):
    for name in ("API_KEY", "ADMIN_KEY", "ORG_ID", "PROJECT_ID"):
        monkeypatch.setenv(f"OPENAI_{name}", "of-the-environment")
    monkeypatch.setenv("OPENAI_BASE_URL", "http://127.0.0.1:1/of-the-environment")
    monkeypatch.setenv(
        "OPENAI_CUSTOM_HEADERS", "X-Mine: of-the-environment\nAuthorization: of-the-environment"
    )
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:1")  # a proxy has no way back to this machine
    with FaultServer([ok("Hello.")]) as fake:
        assert ask(client(fake.url)).text == "Hello."
        Client(Endpoint(fake.url, "m")).complete_all([{"model": "m", "messages": CHAT}])
    with_key, without_key = (request.headers for request in fake.requests)
    assert with_key["authorization"] == f"Bearer {KEY}"
    assert "authorization" not in without_key
    assert "of-the-environment" not in str(with_key) + str(without_key)
    telling = [name for name in with_key if name.startswith(("x-stainless-", "openai-"))]
    assert telling == ["x-stainless-raw-response"]


def test_a_good_answer_comes_with_its_model_tokens_and_time():
    reply, _ = reply_to(ok("Hello."))
    assert (reply.text, reply.error, reply.detail) == ("Hello.", None, "")
    assert (reply.model, reply.tokens_in, reply.tokens_out) == (MODEL, 11, 7)
    assert reply.seconds > 0
    assert json.loads(json.dumps(reply.raw))["model"] == MODEL


@pytest.mark.parametrize(
    ("behaviour", "error", "calls"),
    [
        (faults.status(302, {"Location": "/elsewhere"}), "http", 1),
        (faults.status(429, {"Retry-After": "Wed, 21 Oct 2099 07:28:00 GMT"}), "http", 1),
        (faults.html(502), "http", TRIED_AGAIN),
        (faults.close_socket(), "http", TRIED_AGAIN),
        (faults.refusal(), "refused", 1),
    ],
)
def test_a_fault_is_an_error_in_one_line(behaviour, error, calls):
    reply, requests = reply_to(behaviour, deadline_s=30.0)
    assert (reply.text, reply.error) == (None, error)
    assert reply.detail
    assert "\n" not in reply.detail
    assert requests == reply.calls == calls
    assert len(str(reply.raw)) <= 10_000


@pytest.mark.parametrize("passing", [faults.status(503), faults.close_socket()])
def test_a_passing_fault_is_tried_again(passing):
    reply, requests = reply_to(passing, ok("Hello."), server="vllm", deadline_s=30.0)
    assert (reply.text, reply.calls, requests, reply.dropped) == ("Hello.", 2, 2, ())


def test_a_server_that_is_not_there_is_named_with_its_address():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/v1"
    reply = ask(client(url, deadline_s=30.0))
    assert (reply.error, reply.is_permanent) == ("http", True)
    assert url in reply.detail


@pytest.mark.parametrize("behaviour", [faults.late(30, "late"), faults.trickle(30)])
def test_the_deadline_holds_whatever_trickles_in(behaviour):
    with FaultServer([behaviour]) as fake:
        asked = client(fake.url, deadline_s=0.5)
        reply = ask(asked)
    assert (reply.text, reply.error) == (None, "timeout")
    assert reply.sent["model"] == "some-model"
    assert "no answer within 0.5 s" in reply.detail


def test_a_429_is_waited_for_within_the_deadline():
    reply, requests = reply_to(faults.status(429, {"Retry-After": "0.1"}), ok("Hello."), deadline_s=30.0)
    assert (reply.text, reply.calls, requests) == ("Hello.", 2, 2)
    reply, requests = reply_to(faults.status(429, {"Retry-After": "50"}), ok("Hello."), deadline_s=0.5)
    assert (reply.error, requests) == ("timeout", 1)
    assert reply.detail.startswith("no answer within 0.5 s, HTTP 429 before")


def test_waits_grow_after_each_429_that_names_no_time(monkeypatch):
    waits = []

    async def sleep(seconds):
        waits.append(seconds)

    monkeypatch.setattr(Client, "sleep", staticmethod(sleep))
    reply, requests = reply_to(*[faults.status(429)] * 3, ok("Hello."), deadline_s=30.0)
    assert (reply.text, reply.calls, requests, waits) == ("Hello.", 4, 4, [1.0, 2.0, 4.0])
    waits.clear()
    reply, requests = reply_to(faults.status(429), deadline_s=30.0)
    assert (reply.error, requests, waits) == ("http", 7, list(BACKOFF_S))
    waits.clear()
    used_up = faults.status(429, body={"error": {"code": "insufficient_quota"}})
    reply, requests = reply_to(used_up, deadline_s=30.0)
    assert (reply.error, requests, waits) == ("http", 1, [])


@pytest.mark.parametrize(
    "message",
    [
        "max_tokens is too large: 4096. This model supports at most 2048 completion tokens",
        "Unsupported parameter: 'max_tokens' is not supported. Use 'max_completion_tokens' instead.",
        "This model's maximum context length is 4096 tokens, and you asked for 5000",
        "the request exceeds the available context size, try increasing it",
    ],
)
def test_an_answer_that_may_be_too_long_names_the_profile_that_says_so(message):
    reply, requests = reply_to(faults.status(400, body={"error": {"message": message}}), server="vllm")
    assert (reply.error, requests, reply.dropped) == ("http", 1, ())
    assert "the profile vllm sets max_tokens: 4096; pass --server FILE.yml with another" in reply.detail


def test_parts_of_a_message_that_hold_what_the_model_thinks_are_left_out():
    parts = [
        {"type": "thinking", "thinking": [{"type": "text", "text": "a"}]},
        {"type": "reasoning", "text": "b"},
        {"type": "text", "text": "Hel"},
        {"text": "lo."},
    ]
    assert reply_to(ok(parts))[0].text == "Hello."


def unnamed(code):
    """Refuses the schema, and does not say so."""
    bad = faults.status(code, body={"error": {"message": "bad request"}})
    return lambda handler, body: (bad if "response_format" in body else ok("Hello."))(handler, body)


@pytest.mark.parametrize(
    ("behaviour", "name", "calls"),
    [
        *[(faults.reject_field(name, "Hello.", 400), name, 2) for name in ("seed", "temperature")],
        (faults.reject_field("response_format", "Hello.", 422), "response_format", 2),
        (faults.reject_field("response_format", "Hello.", 500), "response_format", TRIED_AGAIN + 1),
        (unnamed(400), "response_format", 2),
        (unnamed(500), "response_format", TRIED_AGAIN + 1),
    ],
)
def test_a_field_that_the_server_refuses_is_left_out_from_then_on(behaviour, name, calls, caplog):
    with FaultServer([behaviour]) as fake:
        asked = client(fake.url, "vllm", deadline_s=30.0)
        replies = [ask(asked), ask(asked)]
    assert [reply.text for reply in replies] == ["Hello.", "Hello."]
    assert [reply.calls for reply in replies] == [calls, 1]
    assert all(reply.dropped == (name,) and name in reply.detail for reply in replies)
    left = {"model", "messages", "temperature", "max_tokens", "seed", "response_format"} - {name}
    assert set(replies[1].sent) == set(fake.requests[-1].body) == left
    assert name in asked.request_body(CHAT, 7, SCHEMA)  # the question itself stays the same
    assert len([record for record in caplog.records if name in record.message]) == 1


def test_a_lasting_error_is_returned_when_nothing_is_left_to_leave_out():
    reply, requests = reply_to(faults.status(400), server="vllm")
    assert (reply.error, reply.calls, requests) == ("http", 3, 3)
    reply, requests = reply_to(faults.status(400))
    assert (reply.error, reply.calls, requests) == ("http", 1, 1)


ESCAPED = "".join(f"\\u{ord(letter):04x}" for letter in KEY)


@pytest.mark.parametrize(
    "behaviour",
    [
        ok(f"Your key is {KEY}."),
        faults.status(401, {"X-Key": KEY}, {"error": {"message": f"wrong key {KEY}"}}),
        lambda handler, body: handler.send(500, f"no: {KEY}"),
        lambda handler, body: handler.send(401, f'{{"error": "wrong key {ESCAPED}"}}'),
        faults.status(429, {"Retry-After": KEY}),
        faults.cut_json(KEY),
        lambda handler, body: handler.wfile.write(f"{KEY}\r\n\r\n".encode()),
    ],
)
def test_the_key_is_in_no_reply_no_log_and_no_repr(behaviour, caplog):
    caplog.set_level(logging.DEBUG)
    with FaultServer([behaviour]) as fake:
        asked = client(fake.url, deadline_s=30.0)
        reply = ask(asked)
        assert fake.requests[0].headers["authorization"].endswith(KEY)
    assert KEY not in repr(reply) + repr(asked) + repr(vars(asked)) + caplog.text
    assert KEY not in repr([vars(record) for record in caplog.records])


@pytest.mark.parametrize(
    "usage", [None, 7, [], {"prompt_tokens": "7"}, {"prompt_tokens": True}, {"prompt_tokens": -1}]
)
def test_a_completion_may_lack_everything_but_its_text(usage):
    reply = read({"choices": choice(content="Hello."), "usage": usage})
    assert (reply.text, reply.error, reply.model) == ("Hello.", None, None)
    assert (reply.tokens_in, reply.tokens_out) == (None, None)


def test_the_parts_of_a_content_are_joined_without_halves_of_letters():
    parts = [{"type": "text", "text": "Hel"}, {"type": "text", "text": "lo."}, "?"]
    assert read({"choices": choice(content=parts)}).text == "Hello."
    read(b'{"choices": [{"message": {"content": "a\\ud800b"}}]}').text.encode()


INVALID = [
    (b'{"choices": [{"mess', "cut or broken JSON"),
    (b"[1]", "other JSON"),
    (b"x" * LONGEST_BODY, "more than 1000000 bytes"),
    ({"choices": []}, "no choices"),
    ({"choices": [{"message": None}]}, "no text"),
    ({"choices": choice(content=" \n")}, "no text"),
    ({"choices": [{"finish_reason": "length", "message": {"content": ""}}]}, "cut off at max_tokens"),
]
QUOTA = {"error": {"message": "out of\nquota", "code": "insufficient_quota"}}
NO = {"error": {"message": "no"}}
REFUSED = completion(None, choices=choice(content=None, refusal="I can't."))


@pytest.mark.parametrize(
    ("body", "status", "error", "detail", "is_permanent"),
    [
        *[(body, 200, "invalid", detail, False) for body, detail in INVALID],
        (b"<!doctype html><p>It works", 200, "invalid", "a web page", True),
        (QUOTA, 200, "http", "out of quota", False),
        (QUOTA | {"choices": None}, 200, "http", "out of quota", False),
        ({"code": 10007, "message": "traffic is limited", "sid": "cha"}, 200, "http", "traffic is", False),
        (NO, 401, "http", "FPG_LLM_API_KEY", True),
        ({"detail": "Not Found"}, 404, "http", "FPG_LLM_MODEL", True),
        *[(NO, status, "http", "the address leads elsewhere", True) for status in (301, 302, 303, 307, 308)],
        *[(NO, status, "http", f"HTTP {status}", True) for status in (403, 405)],
        *[(NO, status, "http", f"HTTP {status}", False) for status in (400, 408, 429, 500)],
        ({"detail": [{"loc": ["body", "seed"]}]}, 422, "http", "seed", False),
        ({"error": {"message": "a\nb\r\n" * 1000}}, 200, "http", "a b a b", False),
        (b"<html>Bad gateway</html>", 502, "http", "HTTP 502", False),
        (REFUSED, 200, "refused", "I can't.", False),
        ({"code": 10013, "message": "the question was held back"}, 200, "refused", "held back", False),
        ({"error": {"code": "10014", "message": "was held back"}}, 200, "refused", "held back", False),
        ({"error": {"code": "content_filter", "message": "held back"}}, 403, "refused", "held back", False),
    ],
)
def test_a_body_without_an_answer_is_an_error_in_one_line(body, status, error, detail, is_permanent):
    reply = read(body, status)
    assert (reply.text, reply.error, reply.is_permanent) == (None, error, is_permanent)
    assert detail in reply.detail
    assert ("cut off at" in detail) == ("cut off at" in reply.detail)
    assert "<html>" not in reply.detail
    assert "\n" not in reply.detail
    assert len(reply.detail) <= 200


def test_replies_come_in_the_order_of_the_questions():
    with FaultServer([faults.answer(lambda body: f"seed {body['seed']}")]) as fake:
        asked = client(fake.url, "vllm", deadline_s=30.0)
        replies = asked.complete_all([asked.request_body(CHAT, seed) for seed in range(9)], 4)
    assert [reply.text for reply in replies] == [f"seed {seed}" for seed in range(9)]
    assert asked.complete_all([]) == []


@pytest.mark.parametrize("concurrency", [1, 3])
def test_as_many_questions_are_under_way_as_allowed_and_no_more(concurrency):
    under_way, counts, together = threading.Semaphore(concurrency), [], threading.Barrier(concurrency)

    def slow(handler, body):
        counts.append(under_way.acquire(blocking=False))
        together.wait(30)
        under_way.release()
        together.wait(30)
        ok("Hello.")(handler, body)

    with FaultServer([slow]) as fake:
        asked = client(fake.url, deadline_s=60.0)
        asked.complete_all([asked.request_body(CHAT, 0)] * 9, concurrency)
    assert counts == [True] * 9


def test_each_reply_is_kept_as_soon_as_it_arrives_and_an_error_of_that_is_raised():
    def disk_full(index, reply):
        raise OSError("no space left")

    kept, last = [], threading.Event()

    def answer(body):
        return str(body["seed"] if body["seed"] else last.wait(30) and 0)

    def keep(index, reply):
        kept.append((index, reply.text))
        if len(kept) == 2:
            last.set()

    with FaultServer([faults.answer(answer)]) as fake:
        asked = client(fake.url, "vllm", deadline_s=60.0)
        bodies = [asked.request_body(CHAT, seed) for seed in range(3)]
        asked.complete_all(bodies, 3, keep)
        with pytest.raises(OSError, match="no space left"):
            asked.complete_all(bodies, 1, disk_full)
    assert sorted(kept) == [(0, "0"), (1, "1"), (2, "2")]
    assert kept[-1] == (0, "0")


def test_it_works_beside_a_running_event_loop_in_threads_and_awaited():
    with FaultServer([ok("Hello.")]) as fake:
        asked = client(fake.url, deadline_s=30.0)
        body = asked.request_body(CHAT, 0)

        async def notebook():
            return [*asked.complete_all([body]), await asked.complete(body)]

        replies = asyncio.run(notebook()) + asyncio.run(notebook())
        threads = [threading.Thread(target=lambda: replies.append(ask(asked))) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert [reply.text for reply in replies] == ["Hello."] * 8
