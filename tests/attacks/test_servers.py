"""A server of a language model learns nothing, breaks nothing and fills nothing, whatever it answers."""

import json
import tracemalloc

import pytest

from fpg_bench.common.errors import printable
from fpg_bench.planning.llm.client import ERRORS, MOST_TOKENS, read_completion, read_reply
from fpg_bench.planning.llm.probe import probe
from fpg_bench.planning.llm.servers import Endpoint, load_server
from tests.attacks import SCALE, SEED
from tests.attacks.servers import PAINT, hostile_answers
from tests.planning.llm.fault_server import FaultServer, completion, json_body
from tests.planning.llm.playing import KEY, ask, client

ANSWERS = list(hostile_answers(160 * SCALE, KEY, seed=SEED))
MOST_BYTES = 40_000_000


def sent(answer):
    return lambda handler, request: handler.send(answer.status, answer.body, answer.headers)


def kept(reply):
    """All that is kept of a reply, joined as somebody might join it."""
    return json.dumps(reply.raw, allow_nan=False) + (reply.text or "") + reply.detail + (reply.model or "")


@pytest.mark.parametrize("kind", sorted({kind for kind, _ in ANSWERS}))
def test_what_is_kept_of_an_answer_is_harmless(kind):
    for answer in (answer for answer_kind, answer in ANSWERS if answer_kind == kind):
        tracemalloc.start()
        reply = read_reply(answer.status, answer.body, KEY, ("content_filter",))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MOST_BYTES
        assert (reply.error is None) == (reply.text is not None)
        assert reply.error in (None, *ERRORS)
        assert KEY not in kept(reply).replace('", "', "").replace('"}, {"type": "text", "text": "', "")
        assert printable(reply.detail + (reply.model or "")) == reply.detail + (reply.model or "")
        for count in (reply.tokens_in, reply.tokens_out):
            assert count is None or 0 <= count <= MOST_TOKENS
        if reply.text is not None:
            reply.text.encode()
            assert read_completion(reply.raw).text == reply.text  # as a transcript is checked


def test_a_hostile_server_is_read_to_a_bound():
    answers = [answer for _, answer in ANSWERS[:16]]
    with FaultServer([sent(answer) for answer in answers]) as server:
        connection = client(server.url, deadline_s=60.0)
        for _ in answers:
            tracemalloc.start()
            reply = ask(connection)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < MOST_BYTES
            assert KEY not in kept(reply)
    assert {request.headers["accept-encoding"] for request in server.requests} == {"identity"}


def test_a_key_in_pieces_is_struck_out():
    parts = [{"type": "text", "text": f"It is {KEY[:7]}"}, {"type": "text", "text": f"{KEY[7:]}."}]
    body = completion(None, choices=[{"message": {"content": parts}}])
    reply = read_reply(200, json.dumps(body).encode(), KEY, ())
    assert reply.text == "It is ***."
    assert KEY[7:] not in json.dumps(reply.raw)
    body = {"error": {"message": "no", "param": [KEY[:9], KEY[9:]]}}
    reply = read_reply(401, json.dumps(body).encode(), KEY, ())
    assert (reply.error, reply.raw) == ("invalid", None)


@pytest.mark.parametrize(("content", "model"), [("Hello \ud800", "m\ud800"), (PAINT, PAINT), ("Hello", 7)])
def test_probe_ends_with_findings_that_a_terminal_may_show(content, model):
    with FaultServer([json_body(completion(content, model=model))]) as server:
        findings = list(probe(Endpoint(server.url, "some-model", KEY, load_server("generic"))))
    assert len(findings) == 6
    for finding in findings:
        assert printable(finding.detail) == finding.detail


def test_counts_of_tokens_never_end_a_run():
    for number, error in (("9" * 4000, "invalid"), (str(10**20), None)):
        body = json.dumps(completion("x")).replace('"completion_tokens": 7', f'"completion_tokens": {number}')
        reply = read_reply(200, body.encode(), KEY, ())
        assert (reply.error, reply.tokens_out) == (error, None)
