"""Local server of a built site."""

from __future__ import annotations

import errno
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.leaderboard.site.build import MARK

HOST = "127.0.0.1"


class _Handler(SimpleHTTPRequestHandler):
    """Serve files without logging each request."""

    def log_message(self, format: str, *args: object) -> None:
        pass

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-cache")  # show a rebuilt site at once
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()


class _Server(ThreadingHTTPServer):
    request_queue_size = 128  # a page requests all of its files at once; the default of five refuses some


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
