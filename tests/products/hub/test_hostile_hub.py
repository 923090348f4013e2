"""Downloads from a server that is no Hub but wants to write, fill the memory, or never end."""

import contextlib
import json
import threading
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
    return json.dumps({"id": "me/mine", "sha": sha, "siblings": siblings}).encode()


def listed(**values):
    """Lists an agent, and sends whatever the path asks for."""
    return lambda handler: send(
        handler, listing(**values) if "/api/" in handler.path else b"x", ETag="../../../x"
    )


def echo(handler, status=500, **headers):
    send(
        handler,
        handler.headers["Authorization"].encode(),
        status,
        X_Error_Message=handler.headers["Authorization"],
    )


NO_HUB = "does not answer as a Hub does"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda handler: send(handler, b"[]"), NO_HUB),
        (lambda handler: send(handler, b"<html>"), "Expecting value"),
        (lambda handler: send(handler, b'{"sha": ' + b"9" * 5000), "Exceeds the limit"),
        (lambda handler: send(handler, b'{"sha": "' + b"a" * 40 + b'", "siblings": [1]}'), NO_HUB),
        (echo, r"answers with status 500: Bearer \*\*\*"),
        (lambda handler: echo(handler, 404), r"answers with status 404: Bearer \*\*\*"),
    ],
)
def test_a_hostile_hub_is_one_line_and_nothing_is_written(answer, message, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    with hostile(answer) as (url, _):
        point_at(url, tmp_path / "cache", monkeypatch)
        with pytest.raises(UserError, match=message) as raised:
            names.download(NAME)
    assert TOKEN not in str(raised.value)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_commit_that_was_asked_for_is_the_one_that_is_kept(tmp_path, monkeypatch):
    with hostile(listed()) as (url, _):
        point_at(url, tmp_path / "cache", monkeypatch)
        with pytest.raises(UserError, match="answers with another commit, aaaa"):
            names.download(f"{NAME}@{'b' * 40}")
