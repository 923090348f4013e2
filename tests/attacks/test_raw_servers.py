"""Servers of language models that speak HTTP badly, slowly, without end, or not at all."""

from __future__ import annotations

import gzip
import itertools
import json
import random
import time
import tracemalloc
from collections.abc import Callable, Iterator

import pytest

from fpg_bench.products.language_models.client import ERRORS, LONGEST_BODY
from tests.attacks import SCALE, SEED
from tests.products.language_models.fault_server import FaultServer, completion, raw
from tests.products.language_models.playing import ask, client

BODY = json.dumps(completion("Hello.")).encode()
OK = b"HTTP/1.1 200 OK\r\n"
EMPTY = b"Content-Length: 0\r\n\r\n"
JSON = OK + b"Content-Type: application/json\r\n"
CHUNKED = JSON + b"Transfer-Encoding: chunked\r\n\r\n"
MOST_BYTES = 16_000_000  # of memory for one answer
BUFFERS = 8_000_000  # bytes of the sockets' own buffers, which a server fills before anybody reads


def chunk(data: bytes) -> bytes:
    return b"%x\r\n%b\r\n" % (len(data), data)


def sized(data: bytes, headers: bytes = b"") -> bytes:
    return JSON + headers + b"Content-Length: %d\r\n\r\n" % len(data) + data


SHORT = {
    "nothing": b"",
    "another protocol": b"SSH-2.0-OpenSSH_9.6\r\n",
    "headers and no body": JSON + b"Content-Length: 500\r\n\r\n",
    "a body that is cut": sized(BODY)[:-20],
    "a chunk of no size": CHUNKED + b"zz\r\n" + BODY,
    "two lengths": sized(BODY, b"Content-Length: 3\r\n"),
    "a status that is no number": b"HTTP/1.1 fine\r\n\r\n",
    "no content": b"HTTP/1.1 204 No Content\r\n\r\n",
    "gzip that is none": sized(b"\x1f\x8b\x08garbage", b"Content-Encoding: gzip\r\n"),
    "packed without being asked": sized(gzip.compress(BODY), b"Content-Encoding: gzip\r\n"),
    "a page in place of an answer": sized(b"<!DOCTYPE html><h1>It works!</h1>"),
    "a redirect to itself": b"HTTP/1.1 307 Again\r\nLocation: /v1/chat/completions\r\n" + EMPTY,
    "a header that is no text": OK + b"X: \xff\x00\xfe\r\n\r\n",
}


def endless(start: bytes, part: bytes) -> Callable[[], Iterator[bytes]]:
    return lambda: itertools.chain([start], itertools.repeat(part))


def drip(start: bytes, parts: Callable[[], Iterator[bytes]]) -> Callable[[], Iterator[bytes]]:
    def play() -> Iterator[bytes]:
        yield start
        for part in parts():
            time.sleep(0.01)
            yield part

    return play


ENDLESS = {
    "a body": endless(JSON + b"\r\n", b" " * 60_000),
    "chunks": endless(CHUNKED, chunk(b" " * 60_000)),
    "trailers": endless(CHUNKED + chunk(BODY) + b"0\r\n", b"X: y\r\n" * 10_000),
    "headers": endless(JSON, b"X: y\r\n" * 10_000),
    "a status line": endless(b"HTTP/1.1 200 ", b"x" * 60_000),
    "hints before an answer": endless(b"", b"HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n" * 1000),
    "leave to go on": endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 1000),
    "events": endless(OK + b"Content-Type: text/event-stream\r\n\r\n", b'data: {"x": 1}\n\n' * 4000),
    "slow chunks": drip(CHUNKED, lambda: itertools.repeat(chunk(b" "))),
    "a slow status line": drip(b"", lambda: itertools.repeat(b"H")),
}


@pytest.fixture(autouse=True)
def once(monkeypatch):
    """A client that asks once, as what is wrong with these answers does not pass."""
    monkeypatch.setattr("fpg_bench.products.language_models.client.RETRIES", 0)


def check(answer, deadline_s: float = 20.0):
    """Ask a server that answers so; return the reply, and how many bytes the server could send."""
    with FaultServer([raw(answer)]) as server:
        reply = ask(client(server.url, deadline_s=deadline_s))
    assert len(server.requests) == reply.calls == 1
    assert (reply.error is None) == (reply.text is not None)
    assert reply.error in (None, *ERRORS)
    assert reply.detail.isprintable()
    assert len(reply.detail) <= 400
    return reply, server.sent


@pytest.mark.parametrize("answer", SHORT.values(), ids=SHORT)
def test_what_is_no_answer_is_an_error_in_one_line(answer):
    reply, _ = check(answer)
    assert reply.error in ("http", "invalid")


def test_a_redirect_is_not_followed_and_names_what_sets_the_address():
    reply, _ = check(SHORT["a redirect to itself"])
    assert reply.detail == "HTTP 307, the address leads elsewhere (FPG_LLM_BASE_URL)"
    assert reply.is_permanent


@pytest.mark.parametrize("name", ENDLESS)
def test_what_has_no_end_is_read_to_a_bound_or_to_the_deadline(name):
    tracemalloc.start()
    reply, sent = check(ENDLESS[name], deadline_s=0.5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reply.error in ERRORS
    assert peak < MOST_BYTES
    assert sent < LONGEST_BODY + BUFFERS or name in ("hints before an answer", "leave to go on")


def test_generated_answers_are_read_or_are_errors_in_one_line():
    rng = random.Random(SEED)
    errors = []
    for _ in range(60 * SCALE):
        answer = bytearray(rng.choice([sized(BODY), CHUNKED + chunk(BODY) + b"0\r\n\r\n"]))
        for _ in range(rng.randrange(1, 6)):
            place = rng.randrange(len(answer))
            match rng.randrange(4):
                case 0:
                    answer[place] = rng.randrange(256)
                case 1:
                    del answer[place:]
                case 2:
                    answer[place:place] = rng.choice([b"\r\n", b"\x00", b"\xff" * 9, b"0\r\n", b'"', b" "])
                case 3:
                    del answer[place : place + rng.randrange(1, 9)]
            if not answer:
                break
        errors.append(check(bytes(answer))[0].error)
    assert set(errors) >= {None, "http", "invalid"}
