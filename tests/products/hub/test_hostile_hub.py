"""Downloads from a server that is no Hub but wants to write, fill the memory, or never end."""

import contextlib
import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.hub import download as names
from tests.products.hub.conftest import point_at
from tests.products.hub.hub_server import TOKEN

NAME = "hf://me/mine"


@contextlib.contextmanager
def hostile(answer):
    """A Hub that sends to each request what ``answer`` writes; gives its URL and the headers that it saw."""
    seen = []

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *words):
            """Say nothing."""

        def do_GET(self):
            seen.append(dict(self.headers))
            with contextlib.suppress(OSError):
                answer(self)

        do_HEAD = do_GET

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", seen
    finally:
        server.shutdown()
        server.server_close()


def send(handler, data, status=200, **headers):
    handler.send_response(status)
    for key, value in {"Content-Length": str(len(data)), **headers}.items():
        handler.send_header(key.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(data)


def listing(sha="a" * 40, size=None):
    siblings = [{"rfilename": file, "size": size} for file in ("agent.json", "policy.onnx")]
    return json.dumps({"sha": sha, "siblings": siblings}).encode()


def listed(**values):
    """Lists an agent, and sends whatever the path asks for."""
    return lambda handler: send(
        handler, listing(**values) if "/api/" in handler.path else b"x", ETag="../../../x"
    )


def endless(handler):
    handler.send_response(200)
    handler.end_headers()
    for _ in range(3000):
        handler.wfile.write(b" " * 100_000)


def echo(handler, status=500, **headers):
    send(
        handler,
        handler.headers["Authorization"].encode(),
        status,
        X_Error_Message=handler.headers["Authorization"],
    )


def dripping(handler):
    for letter in f"HTTP/1.1 200 OK\r\nX-Drip: {'x' * 100_000}":
        handler.wfile.write(letter.encode())
        time.sleep(0.02)


def holding_the_token(handler):
    token = handler.headers["Authorization"].encode()
    send(handler, listing() if "/api/" in handler.path else token)


NO_HUB = "does not answer as a Hub does"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (listed(sha="main"), NO_HUB),
        (listed(sha="<img src=x>"), NO_HUB),
        (listed(sha="../" * 13 + "a"), NO_HUB),
        (listed(sha=None), NO_HUB),
        (listed(size="1"), NO_HUB),
        (lambda handler: send(handler, b"[]"), NO_HUB),
        (lambda handler: send(handler, b"<html>"), NO_HUB),
        (lambda handler: send(handler, b'{"sha": ' + b"9" * 5000), NO_HUB),
        (lambda handler: send(handler, b'{"sha": "' + b"a" * 40 + b'", "siblings": [1]}'), NO_HUB),
        (listed(size=7), "agent.json has 1 bytes of 7"),
        (endless, "the list of its files holds more than 1,000,000 bytes"),
        (
            lambda handler: endless(handler) if "/api/" not in handler.path else listed()(handler),
            "agent.json holds more",
        ),
        (echo, r"answers with status 500: Bearer \*\*\*"),
        (lambda handler: echo(handler, 404), r"answers with status 404: Bearer \*\*\*"),
        (holding_the_token, "agent.json holds your HF_TOKEN"),
        (dripping, "broke off: timed out after 0.5 s"),
    ],
)
def test_a_hostile_hub_is_one_line_and_nothing_is_written(answer, message, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setattr(names, "DEADLINE_S", 0.5 if answer is dripping else 60)
    with hostile(answer) as (url, _):
        point_at(url, tmp_path / "cache", monkeypatch)
        with pytest.raises(UserError, match=message) as raised:
            names.download(NAME)
    assert len(str(raised.value).splitlines()) == 1
    assert TOKEN not in str(raised.value)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_commit_that_was_asked_for_is_the_one_that_is_kept(tmp_path, monkeypatch):
    with hostile(listed()) as (url, _):
        point_at(url, tmp_path / "cache", monkeypatch)
        with pytest.raises(UserError, match="answers with another commit, aaaa"):
            names.download(f"{NAME}@{'b' * 40}")


def test_a_server_that_the_hub_leads_to_is_not_sent_the_token(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    with hostile(lambda handler: send(handler, b"x")) as (elsewhere, seen):

        def answer(handler):
            if "/api/" in handler.path:
                send(handler, listing())
            else:
                send(
                    handler, b"", 302, Location=f"{elsewhere.replace('127.0.0.1', 'localhost')}{handler.path}"
                )

        with hostile(answer) as (url, own):
            point_at(url, tmp_path / "other", monkeypatch)
            names.download(NAME)
    assert all(headers["authorization"] == f"Bearer {TOKEN}" for headers in own)
    assert len(seen) == 2
    assert not any("authorization" in map(str.lower, headers) for headers in seen)
