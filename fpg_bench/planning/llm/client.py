"""Asking a server of a language model, with a deadline that holds and errors that are told, not raised."""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import time
from collections.abc import Callable, Sequence
from typing import Any
from urllib.parse import urlsplit

from fpg_bench.planning.llm.connection import Connection, background_loop
from fpg_bench.planning.llm.local.server import brought_back
from fpg_bench.planning.llm.replies import Received, Reply, error_text, one_line, read_reply, without
from fpg_bench.planning.llm.servers import Endpoint

_LOOKING_S = 1.0
_LOG = logging.getLogger(__name__)

# Fields that a server may refuse, and the words by which its error names each. The temperature is left out
# only where it is named.
_OPTIONAL = {
    "response_format": ("response_format", "json_schema", "schema", "grammar"),
    "seed": ("seed",),
    "temperature": ("temperature",),
}
_UNNAMED = ("response_format", "seed")
_REFUSING = (400, 422, 500, 501)


class Client:
    """Asks the model behind an endpoint. It may be copied and pickled.

    Args:
        endpoint: whom to ask.
        deadline_s: how long a question may take, with all that is tried again for it; None: as the
            endpoint says.

    Attributes:
        dropped: the fields that this server was found to refuse; they are not sent again.

    Raises:
        UserError: the ``openai`` package is not installed.
    """

    def __init__(self, endpoint: Endpoint, deadline_s: float | None = None) -> None:
        self.endpoint, self.deadline_s = endpoint, deadline_s or endpoint.deadline_s
        self.connection = Connection(endpoint, self.deadline_s)
        self.dropped: set[str] = set()
        self.suspected: set[str] = set()  # by one error of no clear cause

    def request_body(
        self, messages: Sequence[dict[str, str]], seed: int, schema: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """The body of a request; it depends on the arguments and the server's profile alone.

        Args:
            messages: the talk, each with ``role`` and ``content``.
            seed: sent where the profile says that the server knows seeds.
            schema: the JSON schema of the answer, sent in the form that the profile says.
        """
        server = self.endpoint.server
        body = {
            "model": self.endpoint.model,
            "messages": list(messages),
            "temperature": server.temperature,
            server.max_tokens_field: server.max_tokens,
        }
        if server.seed:
            body["seed"] = seed
        if schema is not None and server.response_format != "none":
            body["response_format"] = _response_format(server.response_format, schema)
        return body

    async def complete(self, body: dict[str, Any]) -> Reply:
        """Ask once. Whatever the server does, this gives a reply within the deadline.

        A field that the server refuses is left out, now and from now on. A 429 that names a time to wait
        which fits the deadline is waited for, once.
        """
        start = time.perf_counter()
        talk = _Talk(self, body, start + self.deadline_s)
        try:
            reply = await asyncio.wait_for(talk.reply(), self.deadline_s)
        except TimeoutError:
            there = await _lateness(self.endpoint)
            reply = Reply(error="timeout", detail=f"no answer within {self.deadline_s:g} s{there}")
        if talk.dropped:
            talk.notes.append(f"sent without {', '.join(sorted(talk.dropped))}")
        return dataclasses.replace(
            reply,
            detail="; ".join(filter(None, (reply.detail, *talk.notes))),
            seconds=time.perf_counter() - start,
            sent=talk.sent,
            dropped=tuple(sorted(talk.dropped)),
            calls=talk.calls,
        )

    def complete_all(
        self,
        bodies: Sequence[dict[str, Any]],
        concurrency: int = 1,
        keep: Callable[[int, Reply], Any] = lambda index, reply: None,
    ) -> list[Reply]:
        """Ask several times, and wait for all; from any thread, and beside a running event loop.

        Args:
            bodies: what to send.
            concurrency: how many questions may be under way at once.
            keep: told each reply as soon as it is there, with its index in ``bodies``; in another thread.

        Returns:
            The replies in the order of ``bodies``.
        """
        work = self._gathered(bodies, concurrency, keep)
        future = asyncio.run_coroutine_threadsafe(work, background_loop())
        try:
            return future.result()
        except BaseException:  # Ctrl-C: what is under way is given up
            future.cancel()
            raise

    async def _gathered(
        self, bodies: Sequence[dict[str, Any]], concurrency: int, keep: Callable[[int, Reply], Any]
    ) -> list[Reply]:
        places = asyncio.Semaphore(max(concurrency, 1))

        async def placed(index: int, body: dict[str, Any]) -> Reply:
            async with places:
                reply = await self.complete(body)
            keep(index, reply)
            return reply

        return list(await asyncio.gather(*(placed(*pair) for pair in enumerate(bodies))))


class _Talk:
    """All that is sent for one question, until there is a reply."""

    def __init__(self, client: Client, body: dict[str, Any], until: float) -> None:
        self.client, self.body, self.until = client, body, until
        self.dropped = {name for name in client.dropped if name in body}
        self.sent: dict[str, Any] = {}
        self.calls = 0
        self.waited = False
        self.certain = True
        self.notes: list[str] = []

    async def reply(self) -> Reply:
        endpoint = self.client.endpoint
        while True:
            self.sent = {name: value for name, value in self.body.items() if name not in self.dropped}
            self.calls += 1
            try:
                received = await self.client.connection.send(self.sent)
            except Exception as error:  # whatever a server makes the packages below raise
                if await asyncio.to_thread(brought_back, endpoint.base_url):
                    self.notes.append("the server had ended, and was started again")
                    continue
                return self._unreached(error)
            reply = read_reply(received, endpoint.key, endpoint.server.refusal_codes)
            if reply.error == "http" and (await self._waits(received) or self._drops(received, reply)):
                continue
            if reply.error is None:
                self._remember()
            return reply

    def _unreached(self, error: Exception) -> Reply:
        if isinstance(error, TimeoutError):
            return Reply(error="timeout", detail=f"no answer within {self.client.deadline_s:g} s")
        cause = error.__cause__ or error
        kind = type(cause).__name__
        said = without(self.client.endpoint.key, f"{kind}: {cause}".rstrip(": "))
        detail = one_line(f"no answer from {self.client.endpoint.base_url}: {said}")
        return Reply(error="http", detail=detail, hopeless=kind == "ConnectError")

    async def _waits(self, received: Received) -> bool:
        """Wait as a 429 asks, once, where that leaves time for an answer."""
        wait = received.retry_after_s
        if received.status != 429 or wait is None or self.waited:
            return False
        if time.perf_counter() + wait >= self.until:
            return False
        self.waited = True
        await asyncio.sleep(wait)
        return True

    def _drops(self, received: Received, reply: Reply) -> bool:
        """Leave out the next field that the server may have refused, the one that it names first."""
        if received.status not in _REFUSING:
            return False
        said = error_text(reply.raw)
        left = [name for name in _OPTIONAL if name in self.sent]
        named = [name for name in left if any(word in said for word in _OPTIONAL[name])]
        unnamed = [name for name in left if name in _UNNAMED]
        self.dropped.update((named or unnamed)[:1])
        self.certain &= bool(named) or received.status < 500
        return bool(named or unnamed)

    def _remember(self) -> None:
        """Note what the server answers without; a 500 may be a passing one, so there at the second time."""
        client, new = self.client, self.dropped - self.client.dropped
        if not self.certain:
            new, suspected = new & client.suspected, new
            client.suspected |= suspected
        for name in new:
            client.dropped.add(name)
            _LOG.warning("%s refuses %s; it is left out", client.endpoint.base_url, name)


async def _lateness(endpoint: Endpoint) -> str:
    """Whether a server of this machine that did not answer in time is slow, or gone."""
    if not endpoint.on_this_machine:
        return ""
    url = urlsplit(endpoint.base_url)
    try:
        _, out = await asyncio.wait_for(asyncio.open_connection(url.hostname, url.port or 80), _LOOKING_S)
    except (OSError, TimeoutError):
        return ": the server is gone"
    out.close()
    return ": the server is there, but slow; --deadline gives it longer"


def _response_format(form: str, schema: dict[str, Any]) -> dict[str, Any]:
    if form == "json_schema":
        return {"type": form, "json_schema": {"name": "plan", "strict": True, "schema": schema}}
    return {"type": "json_object", **({"schema": schema} if form == "json_object_with_schema" else {})}
