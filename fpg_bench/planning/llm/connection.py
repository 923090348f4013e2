"""The way to a server: the ``openai`` package's client, kept from saying or reading more than it should."""

from __future__ import annotations

import asyncio
import functools
import importlib
import logging
import threading
from collections.abc import AsyncIterator
from typing import Any

from fpg_bench.common.extras import need
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
                return Received(response.status_code, await response.read())
        except openai.APITimeoutError:
            raise TimeoutError from None
        except openai.APIStatusError as error:
            wait = error.response.headers.get("retry-after", "")
            seconds = float(wait) if wait.replace(".", "", 1).isdecimal() else None
            return Received(error.status_code, error.response.content, seconds)

    def _connected(self) -> Any:
        """The package's client. Its sockets belong to one event loop, so each loop gets a new one."""
        loop = asyncio.get_running_loop()
        if self._loop is not loop:
            self._api, self._loop = _connect(self.endpoint, self.timeout_s), loop
        return self._api


def _openai() -> Any:
    need("llm", "openai")
    import openai

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
        request.headers["Accept-Encoding"] = "identity"  # what is unpacked has no bound
        if endpoint.key:
            request.headers["Authorization"] = f"Bearer {endpoint.key}"

    http = openai.DefaultAsyncHttpxClient(
        event_hooks={"request": [keep_to_headers], "response": [_bound]},
        follow_redirects=False,  # the key goes to the server that it is for, and to no other
        trust_env=not endpoint.on_this_machine,  # a proxy has no way back to this machine
        timeout=timeout_s,
    )
    return openai.AsyncOpenAI(
        base_url=endpoint.base_url, api_key="none", max_retries=0, timeout=timeout_s, http_client=http
    )


async def _bound(response: Any) -> None:
    """Have no more than ``LONGEST_BODY`` read of a response, whoever reads it, and nothing unpacked."""
    response.headers.pop("content-encoding", None)
    response.stream = _stream_type(response)(response.stream)


@functools.cache
def _bounded(base: type) -> type:
    class Bounded(base):
        """A stream of bytes that ends where it becomes too long."""

        def __init__(self, stream: Any) -> None:
            self._stream = stream

        async def __aiter__(self) -> AsyncIterator[bytes]:
            left = LONGEST_BODY
            async for part in self._stream:
                yield part[:left]
                left -= len(part)
                if left <= 0:
                    return

        async def aclose(self) -> None:
            await self._stream.aclose()

    return Bounded


def _stream_type(response: Any) -> type:
    """The bounded kind of stream of the package that a response is of: the one that ``openai`` stands on."""
    package = importlib.import_module(type(response).__module__.partition(".")[0])
    return _bounded(package.AsyncByteStream)


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
