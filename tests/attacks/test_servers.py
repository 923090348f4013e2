"""A server of a language model learns nothing, breaks nothing and fills nothing, whatever it answers."""

from __future__ import annotations

import base64
import gzip
import json
import random
import tracemalloc
import urllib.parse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from fpg_bench.common.errors import printable
from fpg_bench.products.language_models.client import ERRORS, MOST_TOKENS, read_completion, read_reply, redact
from tests.attacks import SCALE, SEED
from tests.attacks.json_texts import hostile_text
from tests.products.language_models.fault_server import FaultServer, completion
from tests.products.language_models.playing import KEY, ask, client

PAINT = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202e\u2028\r"
STATUSES = (200, 200, 200, 201, 301, 400, 401, 404, 422, 429, 500, 503)


@dataclass(frozen=True)
class Hostile:
    """One answer: its status, headers and body."""

    status: int
    headers: dict[str, str]
    body: bytes


def hostile_answers(count: int, key: str, seed: int = 0) -> Iterator[tuple[str, Hostile]]:
    """So many answers, each with its kind, from a server that was given this key."""
    rng = random.Random(seed)
    for number in range(count):
        name = list(_KINDS)[number % len(_KINDS)]
        body, headers = _KINDS[name](rng, key)
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        yield name, Hostile(rng.choice(STATUSES), headers, data)


def _echo(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """The key in one piece, somewhere, somehow written."""
    escaped = "".join(f"\\u{ord(c):04x}" for c in key)
    text = rng.choice([key, escaped, f"Bearer {key}", f"{key}{key}", f"{key[:4]}{key}{key[4:]}"])
    body = json.dumps(_somewhere(rng, "HERE")).replace("HERE", text)
    return (body.encode() if rng.random() < 0.7 else text.encode() + b"\xff"), {"X-Echo": key}


def _somewhere(rng: random.Random, word: str) -> Any:
    places: list[Any] = [
        completion(f"The key is {word}."),
        completion("Hello.", model=word),
        completion("Hello.", id=word),
        {"error": {"message": word, "code": word, "type": word}},
        {"error": word},
        {"detail": [{"loc": [word]}]},
        {"code": 10013, "message": word},
        completion(None, choices=[{"message": {"content": None, "refusal": word}}]),
        [word],
        word,
    ]
    return rng.choice(places)


@pytest.mark.parametrize("before", ["", "x", "Bearer "])
def test_a_key_is_struck_out_however_it_is_written(before):
    key = "sk-abc/DEF+12é34"
    said = before + key
    for form in (
        said,
        " ".join(said),
        json.dumps(said),
        urllib.parse.quote(said, safe=""),
        "".join(f"%{byte:02x}" for byte in said.encode()),
        base64.b64encode(f"{said}yz".encode()).decode(),
        base64.urlsafe_b64encode(said.encode()).decode(),
    ):
        assert len(redact(key, f"the key is {form}.")) < len(f"the key is {form}.") - len(key) + 5, form


def _tokens(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Counts of tokens that no run could add up."""
    many = rng.choice(["9" * 4300, "9" * 4301, "-" + "1" * 400, "1e999", "1e308", "9" * 19, "0.5", "true"])
    body = json.dumps(completion("Hello.", usage={"prompt_tokens": "N", "completion_tokens": "N"}))
    return body.replace('"N"', many).encode(), {}


def _paint(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Characters that move a terminal, or that no file can hold."""
    word = rng.choice([PAINT, "\ud800", "a\udc00b" + PAINT, "\0", "\x7f" * 50])
    return _somewhere(rng, word), {}


def _bomb(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """A few kilobytes that unpack to megabytes; one in the other."""
    data = gzip.compress(b" " * 20_000_000, 9) if rng.random() < 0.3 else gzip.compress(b" " * 2_000_000, 9)
    encoding = "gzip"
    if rng.random() < 0.5:
        data, encoding = gzip.compress(data, 9), "gzip, gzip"
    return data, {"Content-Encoding": rng.choice([encoding, "deflate", "br", "zstd", encoding.upper()])}


def _long(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """More than is read."""
    start = json.dumps(completion(key))[:-40].encode()
    return start + rng.choice([b" ", b"[", b'"', b"9", b"\\ud800"]) * rng.choice([400_000, 1_500_000]), {}


def _json(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Hostile JSON of all kinds, as an answer."""
    return hostile_text(completion("Hello."), rng), {}


def _headers(rng: random.Random, key: str) -> tuple[Any, dict[str, str]]:
    """Headers that are none."""
    wait = rng.choice(["9" * 400, "1e999", "nan", "-1", "", "\u0663", "0." + "9" * 5000, "99999"])
    return completion("Hello."), {"Retry-After": wait.encode("utf-8").decode("latin-1")}


_ALL = (_echo, _tokens, _paint, _bomb, _long, _json, _headers)
_KINDS = {kind.__name__.removeprefix("_"): kind for kind in _ALL}


ANSWERS = list(hostile_answers(80 * SCALE, KEY, seed=SEED))
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
        assert KEY not in kept(reply)
        assert printable(reply.detail + (reply.model or "")) == reply.detail + (reply.model or "")
        for count in (reply.tokens_in, reply.tokens_out):
            assert count is None or 0 <= count <= MOST_TOKENS
        if reply.text is not None:
            reply.text.encode()
            assert read_completion(reply.raw).text == reply.text  # as a transcript is checked


def test_a_hostile_server_is_read_to_a_bound():
    answers = [answer for _, answer in ANSWERS[: len(_KINDS)]]
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


def test_counts_of_tokens_never_end_a_run():
    for number, error in (("9" * 4000, "invalid"), (str(10**20), None)):
        body = json.dumps(completion("x")).replace('"completion_tokens": 7', f'"completion_tokens": {number}')
        reply = read_reply(200, body.encode(), KEY, ())
        assert (reply.error, reply.tokens_out) == (error, None)
