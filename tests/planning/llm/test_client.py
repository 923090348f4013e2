"""The client: what it sends, what it makes of every fault, its deadline, and where the key does not go."""

from __future__ import annotations

import json
import logging
import socket
import sys

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.planning.llm.client import Client
from fpg_bench.planning.llm.servers import Endpoint, load_server

from . import fault_server as faults
from .asking import KEY, SCHEMA, TALK, ask, client
from .fault_server import MODEL, FaultServer, ok


def reply_to(*behaviours, **options):
    """The reply of a server that behaves so, and how many requests it saw."""
    with FaultServer(behaviours) as server:
        return ask(client(server.url, **options)), len(server.requests)


# What is sent


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
    assert request.body["messages"] == TALK
    assert request.body.get("seed", 7) == 7


def test_the_schema_is_sent_in_the_form_that_the_profile_says():
    def form(response_format):
        asked = client("http://127.0.0.1:1", response_format=response_format)
        return asked.request_body(TALK, 0, SCHEMA).get("response_format")

    assert form("none") is None
    assert form("json_object") == {"type": "json_object"}
    assert form("json_object_with_schema") == {"type": "json_object", "schema": SCHEMA}
    assert form("json_schema")["json_schema"]["schema"] == SCHEMA
    assert "response_format" not in client("http://127.0.0.1:1", "vllm").request_body(TALK, 0)


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
        Client(Endpoint(fake.url, "m")).complete_all([{"model": "m", "messages": TALK}])
    with_key, without_key = (request.headers for request in fake.requests)
    assert with_key["authorization"] == f"Bearer {KEY}"
    assert "authorization" not in without_key
    assert "of-the-environment" not in str(with_key) + str(without_key)
    telling = [name for name in with_key if name.startswith(("x-stainless-", "openai-"))]
    assert telling == ["x-stainless-raw-response"]


# What comes back


def test_a_good_answer_is_told_with_its_model_tokens_and_time():
    reply, _ = reply_to(faults.late(0.05, "Hello."))
    assert (reply.text, reply.error, reply.detail) == ("Hello.", None, "")
    assert (reply.model, reply.tokens_in, reply.tokens_out) == (MODEL, 11, 7)
    assert 0.05 <= reply.seconds < 5
    assert json.loads(json.dumps(reply.raw))["model"] == MODEL


@pytest.mark.parametrize(
    ("behaviour", "text"),
    [(faults.bare("Hello."), "Hello."), (faults.think("Hello.", "Hm."), "<think>Hm.</think>\nHello.")],
)
def test_answers_of_other_forms_are_answers(behaviour, text):
    reply, _ = reply_to(behaviour)
    assert (reply.text, reply.error) == (text, None)


@pytest.mark.parametrize(
    ("behaviour", "error"),
    [
        (faults.status(401), "http"),
        (faults.status(403), "http"),
        (faults.status(404), "http"),
        (faults.status(429), "http"),
        (faults.status(500), "http"),
        (faults.status(503), "http"),
        (faults.status(302, {"Location": "/elsewhere"}), "http"),
        (faults.status(429, {"Retry-After": "Wed, 21 Oct 2099 07:28:00 GMT"}), "http"),
        (faults.status(429, {"Retry-After": "-1"}), "http"),
        (faults.error_object(), "http"),
        (faults.html(502), "http"),
        (faults.close_socket(), "http"),
        (faults.close_socket(after=20), "http"),
        (lambda handler, body: handler.send(200, b"no gzip", {"Content-Encoding": "gzip"}), "invalid"),
        (faults.html(), "invalid"),
        (faults.empty_choices(), "invalid"),
        (faults.ok(None), "invalid"),
        (faults.cut_json(), "invalid"),
        (lambda handler, body: handler.send(200, "x" * 3_000_000), "invalid"),
        (faults.refusal(), "refused"),
        (faults.content_filter(), "refused"),
    ],
)
def test_a_fault_is_told_after_one_request(behaviour, error):
    reply, requests = reply_to(behaviour)
    assert (reply.text, reply.error) == (None, error)
    assert reply.detail
    assert "\n" not in reply.detail
    assert requests == reply.calls == 1
    assert len(str(reply.raw)) <= 10_000


def test_a_server_that_is_not_there_is_told_with_its_address():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/v1"
    reply = ask(client(url))
    assert reply.error == "http"
    assert url in reply.detail


def test_a_redirect_is_not_followed():
    with FaultServer([ok("stolen")]) as other:
        reply, _ = reply_to(faults.status(307, {"Location": f"{other.url}/chat/completions"}))
    assert reply.error == "http"
    assert not other.requests


# The deadline


@pytest.mark.parametrize("behaviour", [faults.late(30, "late"), faults.trickle(30)])
def test_the_deadline_holds_whatever_trickles_in(behaviour):
    reply, _ = reply_to(behaviour, deadline_s=0.2)
    assert (reply.text, reply.error) == (None, "timeout")
    assert 0.2 <= reply.seconds < 5
    assert reply.sent["model"] == "some-model"


def test_a_429_is_waited_for_once_where_that_fits_the_deadline():
    limited = faults.status(429, {"Retry-After": "0.1"})
    reply, requests = reply_to(limited, ok("Hello."))
    assert (reply.text, reply.calls, requests) == ("Hello.", 2, 2)
    assert reply.seconds >= 0.1
    reply, requests = reply_to(limited, limited, ok("Hello."))
    assert (reply.error, reply.calls, requests) == ("http", 2, 2)


def test_a_429_that_asks_for_more_than_the_deadline_is_told_at_once():
    reply, requests = reply_to(faults.status(429, {"Retry-After": "60"}), ok("Hello."))
    assert (reply.error, requests) == ("http", 1)
    assert reply.seconds < 5


# Fields that a server refuses


@pytest.mark.parametrize("name", ["seed", "response_format", "temperature"])
@pytest.mark.parametrize("code", [400, 422, 500])
def test_a_field_that_the_server_names_is_left_out_from_then_on(name, code, caplog):
    with FaultServer([faults.reject_field(name, "Hello.", code)]) as fake:
        asked = client(fake.url, "vllm")
        replies = [ask(asked), ask(asked)]
    assert [reply.text for reply in replies] == ["Hello.", "Hello."]
    assert [reply.calls for reply in replies] == [2, 1]
    assert all(reply.dropped == (name,) and name in reply.detail for reply in replies)
    left = {"model", "messages", "temperature", "max_tokens", "seed", "response_format"} - {name}
    assert set(replies[1].sent) == set(fake.requests[1].body) == left
    assert name in asked.request_body(TALK, 7, SCHEMA)  # what is asked stays, whatever was found out
    assert len([record for record in caplog.records if name in record.message]) == 1


def unnamed(name, code):
    """Refuses a field, and does not say which."""
    bad = faults.status(code, body={"error": {"message": "bad request"}})
    return lambda handler, body: (bad if name in body else ok("Hello."))(handler, body)


@pytest.mark.parametrize(("code", "calls"), [(400, [2, 1, 1]), (500, [2, 2, 1])])
def test_an_error_that_names_nothing_is_tried_without_the_schema(code, calls):
    with FaultServer([unnamed("response_format", code)]) as fake:
        asked = client(fake.url, "vllm")
        replies = [ask(asked) for _ in range(3)]
    assert [reply.calls for reply in replies] == calls
    assert all(reply.dropped == ("response_format",) for reply in replies)


def test_a_passing_error_costs_no_field_for_good():
    with FaultServer([faults.status(500), ok("Hello.")]) as fake:
        asked = client(fake.url, "vllm")
        first, second = ask(asked), ask(asked)
    assert (first.text, second.text) == ("Hello.", "Hello.")
    assert "response_format" in second.sent


def test_a_lasting_error_is_told_when_nothing_is_left_to_leave_out():
    reply, requests = reply_to(faults.status(400), server="vllm")
    assert (reply.error, reply.calls, requests) == ("http", 3, 3)
    reply, requests = reply_to(faults.status(400))
    assert (reply.error, reply.calls, requests) == ("http", 1, 1)


# The key


def says_in_its_status_line(handler, body):
    handler.send_response(200, KEY)
    handler.send_header("Content-Length", "0")
    handler.end_headers()


TRICKLE = faults.trickle(30)


@pytest.mark.parametrize(
    "behaviour",
    [
        ok(f"Your key is {KEY}."),
        faults.status(401, {"X-Key": KEY}, {"error": {"message": f"wrong key {KEY}"}}),
        lambda handler, body: handler.send(500, f"no: {KEY}"),
        faults.status(429, {"Retry-After": KEY}),
        faults.close_socket(),
        TRICKLE,
        faults.cut_json(KEY),
        says_in_its_status_line,
        lambda handler, body: handler.wfile.write(f"{KEY}\r\n\r\n".encode()),
    ],
)
def test_the_key_is_in_no_reply_no_log_and_no_repr(behaviour, caplog):
    caplog.set_level(logging.DEBUG)
    with FaultServer([behaviour]) as fake:
        asked = client(fake.url, deadline_s=0.5 if behaviour is TRICKLE else 3)
        reply = ask(asked)
        assert fake.requests[0].headers["authorization"].endswith(KEY)
    assert KEY not in repr(reply) + repr(asked) + repr(vars(asked)) + caplog.text
    assert KEY not in repr([vars(record) for record in caplog.records])


def test_without_the_package_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(UserError, match=r'pip install "fpg-bench\[llm\]"'):
        client("http://127.0.0.1:1/v1")


# A real server


def test_free_text_of_a_real_server_is_told(llama_server):
    reply = ask(client(llama_server.url, max_tokens=50))
    assert reply.error is None
    assert reply.text
    assert reply.tokens_in > 0
    assert 0 < reply.tokens_out <= 50


def test_a_real_server_enforces_a_schema_and_repeats_a_seed(llama_server):
    endpoint = Endpoint(llama_server.url, llama_server.model, KEY, load_server("llama.cpp"))
    asked = Client(endpoint, 20)
    bounds = {"type": "integer", "minimum": 0, "maximum": 1500}
    point = {
        "type": "object",
        "properties": dict.fromkeys("xyz", bounds),
        "required": ["x", "y", "z"],
        "additionalProperties": False,
    }
    points = {"type": "array", "items": point, "minItems": 4, "maxItems": 4}
    schema = {"type": "object", "properties": {"waypoints": points}, "required": ["waypoints"]}
    bodies = [asked.request_body(TALK, seed, schema) for seed in (1, 1, 2)]
    first, again, other = (reply.text for reply in asked.complete_all(bodies))
    assert first == again != other
    for text in (first, other):
        waypoints = json.loads(text)["waypoints"]
        assert len(waypoints) == 4
        assert all(0 <= point[axis] <= 1500 for point in waypoints for axis in "xyz")
