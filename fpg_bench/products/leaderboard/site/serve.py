"""Local server of a built site."""

from __future__ import annotations

import errno
import io
import threading
from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit

from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard.site.mark import MARK

HOST = "127.0.0.1"
_LOCAL = (HOST, "localhost")  # a name of another host comes from a page that was led here
_IDLE_S = 5.0  # that a client may hold a thread for without sending anything
_MOST_THREADS = 64


class _Handler(SimpleHTTPRequestHandler):
    """Serve the regular files of a folder, to this machine, without logging each request."""

    timeout = _IDLE_S

    def send_head(self) -> io.BytesIO | BinaryIO | None:
        if not self._is_local():
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
        elif not self._is_inside():
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            return super().send_head()
        return None

    def _is_local(self) -> bool:
        try:
            return urlsplit(f"//{self.headers.get('Host', HOST)}").hostname in _LOCAL
        except ValueError:
            return False

    def _is_inside(self) -> bool:
        """Return True if the path is a file, or a folder with a page; links may not lead out."""
        try:
            path = Path(self.translate_path(self.path))
            file = (path / "index.html" if path.is_dir() else path).resolve()
            return file.is_file() and file.is_relative_to(Path(self.directory).resolve())
        except (OSError, ValueError):  # a name that is too long, or with a NUL
            return False

    def log_message(self, format: str, *args: object) -> None:
        pass

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-cache")  # show a rebuilt site at once
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()


class _Server(ThreadingHTTPServer):
    request_queue_size = 128  # a page requests all of its files at once; the default of five refuses some

    def __init__(self, *address: Any) -> None:
        self._free = threading.BoundedSemaphore(_MOST_THREADS)
        super().__init__(*address)

    def process_request(self, request: Any, client_address: Any) -> None:
        self._free.acquire()  # the others wait in the queue
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()


def make_server(folder: str | Path, port: int) -> ThreadingHTTPServer:
    """Return a server of a built site, not yet serving.

    Args:
        folder: the site's folder.
        port: 0: any free port.

    Raises:
        UserError: no site there, or the port is in use or not allowed.
    """
    folder = Path(folder)
    if not (folder / MARK).is_file():
        raise UserError(f"site {folder}: nothing is built there; run fpg-bench leaderboard build")
    try:
        return _Server((HOST, port), partial(_Handler, directory=str(folder)))
    except OverflowError as error:
        raise UserError(f"port: expected 0 to 65535, got {port}") from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise UserError(f"port {port}: is in use; name another by --port, 0 for any") from error
        if error.errno == errno.EACCES:
            raise UserError(f"port {port}: is not allowed; name one above 1023 by --port") from error
        raise
