"""A server on loopback that answers each request with bytes of its own, HTTP or not::

    with RawServer(b"HTTP/1.1 200 OK\\r\\n\\r\\n") as server:
        ...  # a client that is pointed at server.url
    assert server.sent < 1_000_000

An answer is bytes, or a function of an iterator for what has no end; ``sent`` counts what could be sent.
"""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Callable, Iterator

Answer = bytes | Callable[[], Iterator[bytes]]
MOST_SENT = 50_000_000  # bytes after which an answer without end is given up


class RawServer:
    """Serves while the ``with`` block lasts; ``url`` is the base URL."""

    def __init__(self, answer: Answer) -> None:
        self.answer, self.sent, self.requests = answer, 0, 0
        self.stopping = threading.Event()

    def __enter__(self) -> RawServer:
        self._server = _Server(("127.0.0.1", 0), _Handler)
        self._server.owner = self
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/v1"
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stopping.set()
        self._server.shutdown()
        self._server.server_close()


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    owner: RawServer

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that hangs up is no news."""


class _Handler(socketserver.BaseRequestHandler):
    server: _Server

    def handle(self) -> None:
        owner = self.server.owner
        owner.requests += 1
        head = b""
        while b"\r\n\r\n" not in head:
            if not (part := self.request.recv(65536)):
                return
            head += part
        parts = [owner.answer] if isinstance(owner.answer, bytes) else owner.answer()
        for part in parts:
            if owner.stopping.is_set() or owner.sent > MOST_SENT:
                return
            self.request.sendall(part)
            owner.sent += len(part)
