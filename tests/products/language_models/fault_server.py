"""A server on loopback that plays what servers of language models do, well and badly, as a script says::

    with FaultServer([status(500), ok("Next directions: ...")]) as server:
        ...  # a client that is pointed at server.url
    assert len(server.requests) == 2

Each request takes the next behaviour; when the last is reached, it stays. A behaviour is a function of the
handler and the request's body; ``answer(function)`` makes one from a function of the body to a text, and
``raw(data)`` one from bytes, HTTP or not, or from a function of an iterator for what has no end.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

MODEL = "fault-model"
MOST_SENT = 50_000_000  # bytes after which an answer without end is given up


@dataclass(frozen=True)
class Received:
    """One request: its path, its headers in lower case, and its JSON body."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]


class FaultServer:
    """Serves while the ``with`` block lasts.

    Attributes:
        url: the base URL.
        requests: the requests so far.
        sent: bytes of raw answers that could be sent.
    """

    def __init__(self, behaviours: Iterable[Behaviour]) -> None:
        self.behaviours = list(behaviours)
        self.requests: list[Received] = []
        self.sent = 0
        self.stopping = threading.Event()
        self._lock = threading.Lock()

    def __enter__(self) -> FaultServer:
        self._server = _Server(("127.0.0.1", 0), _Handler)
        self._server.owner = self
        self.url = f"http://127.0.0.1:{self._server.server_port}/v1"
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stopping.set()
        self._server.shutdown()
        self._server.server_close()

    def take(self, received: Received) -> Behaviour:
        """Note a request, and say how it is answered."""
        with self._lock:
            self.requests.append(received)
            return self.behaviours[min(len(self.requests), len(self.behaviours)) - 1]


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64
    owner: FaultServer

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is no news."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: _Server

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        headers = {name.lower(): value for name, value in self.headers.items()}
        self.server.owner.take(Received(self.path, headers, body))(self, body)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing on the test's screen."""

    def wait(self, seconds: float) -> None:
        """Let time pass, but not beyond the end of the test."""
        self.server.owner.stopping.wait(seconds)

    def send(
        self,
        code: int,
        body: str | bytes,
        headers: dict[str, str] | None = None,
        kind: str = "application/json",
    ) -> None:
        data = body.encode() if isinstance(body, str) else body
        self.start(code, len(data), headers, kind)
        self.wfile.write(data)

    def start(self, code: int, size: int, headers: dict[str, str] | None, kind: str) -> None:
        self.send_response(code)
        for name, value in {"Content-Type": kind, "Content-Length": str(size), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()


Behaviour = Callable[[_Handler, dict[str, Any]], None]


def completion(text: str | None, **changes: Any) -> dict[str, Any]:
    """The body of a chat completion; ``changes`` replace its fields, None drops one."""
    message = {"role": "assistant", "content": text}
    body = {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 0,
        "model": MODEL,
        "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 11, "completion_tokens": 7, "total_tokens": 18},
    }
    return {name: value for name, value in {**body, **changes}.items() if value is not None}


def json_body(body: Any, code: int = 200, headers: dict[str, str] | None = None) -> Behaviour:
    """Any JSON."""
    return lambda handler, request: handler.send(code, json.dumps(body), headers)


def ok(text: str | None, **changes: Any) -> Behaviour:
    """A good answer."""
    return json_body(completion(text, **changes))


def answer(function: Callable[[dict[str, Any]], str]) -> Behaviour:
    """A good answer that depends on the request's body."""
    return lambda handler, request: handler.send(200, json.dumps(completion(function(request))))


def refusal(text: str = "I'm sorry, but I can't help with that.") -> Behaviour:
    """A refusal in the field that is there for it, the content empty."""
    message = {"role": "assistant", "content": None, "refusal": text}
    return ok(None, choices=[{"index": 0, "message": message, "finish_reason": "stop"}])


def status(code: int, headers: dict[str, str] | None = None, body: Any = None) -> Behaviour:
    """An HTTP error with an error object, e.g. ``status(429, {"Retry-After": "1"})``."""
    error = {"error": {"message": f"status {code}", "type": "error", "code": code}}
    return json_body(error if body is None else body, code, headers)


def error_object() -> Behaviour:
    """An error object in a 200."""
    return json_body({"error": {"message": "out of quota", "type": "insufficient_quota"}})


def html(code: int = 200) -> Behaviour:
    """A web page, as a proxy or a wrong base URL gives it."""
    page = "<html><body><h1>It works!</h1></body></html>"
    return lambda handler, request: handler.send(code, page, kind="text/html")


def cut_json(text: str = "a long answer") -> Behaviour:
    """A body that ends in the middle, though its length agrees."""
    body = json.dumps(completion(text))
    return lambda handler, request: handler.send(200, body[: len(body) // 2])


def late(seconds: float, text: str) -> Behaviour:
    """A good answer after some seconds of silence."""

    def play(handler: _Handler, request: dict[str, Any]) -> None:
        handler.wait(seconds)
        handler.send(200, json.dumps(completion(text)))

    return play


def trickle(seconds: float, text: str = "late") -> Behaviour:
    """A good answer whose first bytes come at once, and then one every 20 ms for so long."""

    def play(handler: _Handler, request: dict[str, Any]) -> None:
        data, blanks = json.dumps(completion(text)).encode(), max(int(seconds / 0.02), 1)
        handler.start(200, blanks + len(data), None, "application/json")
        for _ in range(blanks):
            handler.wfile.write(b" ")  # white space may stand before JSON
            handler.wait(0.02)
        handler.wfile.write(data)

    return play


def close_socket(after: int = 0) -> Behaviour:
    """Hangs up: before any byte, or after so many bytes of a good answer."""

    def play(handler: _Handler, request: dict[str, Any]) -> None:
        handler.close_connection = True
        if after:
            data = json.dumps(completion("cut off")).encode()
            handler.start(200, len(data), None, "application/json")
            handler.wfile.write(data[:after])

    return play


def raw(data: bytes | Callable[[], Iterator[bytes]]) -> Behaviour:
    """Bytes in the place of a response, up to the end of the test; then it hangs up."""

    def play(handler: _Handler, request: dict[str, Any]) -> None:
        handler.close_connection = True
        owner = handler.server.owner
        for part in [data] if isinstance(data, bytes) else data():
            if owner.stopping.is_set() or owner.sent > MOST_SENT:
                return
            handler.wfile.write(part)
            owner.sent += len(part)

    return play


def reject_field(name: str, text: str, code: int = 400) -> Behaviour:
    """A good answer, but an error to every request that holds the field."""
    good, bad = ok(text), status(code, body={"error": {"message": f"unknown field {name}"}})
    return lambda handler, request: (bad if name in request else good)(handler, request)
