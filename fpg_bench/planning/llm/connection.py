"""The way to a server: the ``openai`` package's client, kept from saying or reading more than it should."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.planning.llm.replies import LONGEST_BODY, Received
from fpg_bench.planning.llm.servers import Endpoint

# All that leaves this machine beside the body. The package would add the kind of machine, and whatever
# OPENAI_* variables say; by the last of these it knows to hand out the body unread.
_HEADERS = {
    "accept",
    "accept-encoding",
    "connection",
    "content-length",
    "content-type",
    "host",
    "user-agent",
    "x-stainless-raw-response",
}

_WIRE_LOGS = ("openai", "httpx", "httpx2", "httpcore", "httpcore2")


class Connection:
    """Sends requests to an endpoint. It may be copied and pickled.

    Args:
        endpoint: whom to ask.
        timeout_s: the longest silence; a deadline for the whole is the caller's.

    Raises:
        UserError: the ``openai`` package is not installed.
    """

    def __init__(self, endpoint: Endpoint, timeout_s: float) -> None:
        _openai()
        self.endpoint, self.timeout_s = endpoint, timeout_s
        self._api: Any = None
        self._loop: asyncio.AbstractEventLoop | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_api": None, "_loop": None}

    async def send(self, body: dict[str, Any]) -> Received:
        """Send one request and read what comes, up to ``LONGEST_BODY``.

        Raises:
            TimeoutError: the server was silent for too long.
            Exception: whatever the packages below raise about a broken connection.
        """
        openai = _openai()
        try:
            talk = self._connected().chat.completions.with_streaming_response.create(**body)
            async with talk as response:
                data = b""
                async for part in response.iter_bytes():
                    data += part
                    if len(data) >= LONGEST_BODY:
                        break
                return Received(response.status_code, data)
        except openai.APITimeoutError:
            raise TimeoutError from None
        except openai.APIStatusError as error:
            wait = error.response.headers.get("retry-after", "")
            seconds = float(wait) if wait.replace(".", "", 1).isdecimal() else None
            return Received(error.status_code, error.response.content[:LONGEST_BODY], seconds)

    def _connected(self) -> Any:
        """The package's client. Its sockets belong to one event loop, so each loop gets a new one."""
        loop = asyncio.get_running_loop()
        if self._loop is not loop:
            self._api, self._loop = _connect(self.endpoint, self.timeout_s), loop
        return self._api


def _openai() -> Any:
    try:
        import openai
    except ImportError:
        raise UserError("the planner llm needs the package openai: pip install 'fpg-bench[llm]'") from None
    return openai


def _connect(endpoint: Endpoint, timeout_s: float) -> Any:
    """The package's asynchronous client, which takes nothing from the environment but proxies."""
    openai = _openai()
    for name in _WIRE_LOGS:  # they show headers that a server sends back, and it may send back the key
        logging.getLogger(name).setLevel(logging.WARNING)

    async def keep_to_headers(request: Any) -> None:
        for name in list(request.headers):
            if name.lower() not in _HEADERS:
                del request.headers[name]
        request.headers["Connection"] = "close"  # answers take seconds, and no socket is left open
        if endpoint.key:
            request.headers["Authorization"] = f"Bearer {endpoint.key}"

    http = openai.DefaultAsyncHttpxClient(
        event_hooks={"request": [keep_to_headers]},
        follow_redirects=False,  # the key goes to the server that it is for, and to no other
        trust_env=not endpoint.on_this_machine,  # a proxy has no way back to this machine
        timeout=timeout_s,
    )
    return openai.AsyncOpenAI(
        base_url=endpoint.base_url, api_key="none", max_retries=0, timeout=timeout_s, http_client=http
    )


# One thread for all connections of a process: it ends with the process, whatever is under way

_STARTING = threading.Lock()
_LOOP: tuple[asyncio.AbstractEventLoop, threading.Thread] | None = None


def background_loop() -> asyncio.AbstractEventLoop:
    """The event loop that runs on a thread of its own, started when it is first asked for."""
    global _LOOP
    with _STARTING:
        if _LOOP is None or not _LOOP[1].is_alive():  # a forked process has its parent's loop, not its thread
            loop = asyncio.new_event_loop()
            thread = threading.Thread(target=loop.run_forever, name="fpg-bench-llm", daemon=True)
            thread.start()
            _LOOP = (loop, thread)
        return _LOOP[0]
