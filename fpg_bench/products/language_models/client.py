"""Client of OpenAI-compatible servers: the ``openai`` package, bounded in bytes and time.

Retries of passing errors and the errors of connections are the package's own. Added here are longer waits
after a 429, a deadline for the complete question, a bound on the bytes that are read, and the removal of the
key from everything that is kept. No redirect is followed, and no header is sent beyond those that a request
needs.
"""

from __future__ import annotations

import asyncio
import base64
import functools
import importlib
import json
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from fpg_bench.common.errors import printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.strict_json import Json, read_plain
from fpg_bench.products.language_models.servers import TOKEN_FIELDS, Endpoint

ERRORS = ("timeout", "http", "refused", "invalid")
LONGEST_BODY = 1_000_000  # bytes of a body that are read
MOST_TOKENS = 10**9  # of one answer; a server that reports more is wrong
SHORTEST_SECRET = 8  # shorter keys are words such as "none" and "x", which stand in any text
DEADLINE_S = 30.0  # of a question with all its retries
RETRIES = 2  # after a lost connection, or a status such as 503
BACKOFF_S = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)  # waits after each 429 that names no time to wait
_WAIT_HEADERS = {"retry-after", "retry-after-ms"}
_LONGEST_RAW = 10_000  # characters kept of a body that is not JSON
_LONGEST_DETAIL = 200
_PERMANENT = (401, 403, 404, 405)  # statuses that a retry cannot mend; redirects are not followed either
_ADVICE = {
    401: ", the key is refused (FPG_LLM_API_KEY)",
    403: ", the key is refused (FPG_LLM_API_KEY)",
    404: ", no such address or model (FPG_LLM_BASE_URL, FPG_LLM_MODEL)",
}
_ADVICE |= dict.fromkeys((301, 302, 303, 307, 308), ", the address leads elsewhere (FPG_LLM_BASE_URL)")
_WEB_PAGE = "a web page"
_TEXTS = ("text", "output_text")  # types of a message's parts; others hold what the model thinks

# Fields that a server may refuse, and the words by which its error names each. The temperature is left out
# only where it is named.
_OPTIONAL = {
    "response_format": ("response_format", "json_schema", "schema", "grammar"),
    "seed": ("seed",),
    "temperature": ("temperature",),
}
_REFUSING = (400, 422, 500, 501)
_ABOUT_LENGTH = (*TOKEN_FIELDS, "context length", "context window", "context_length", "context size")

# All headers that are sent. The package would add the kind of machine, and whatever OPENAI_* variables say;
# the last of these makes it hand out the body unread.
_HEADERS = {
    "accept", "accept-encoding", "connection", "content-length", "content-type", "host", "user-agent",
    "x-stainless-raw-response",
}  # fmt: skip
_WIRE_LOGS = ("openai", "httpx", "httpx2", "httpcore", "httpcore2")
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Reply:
    """Answer of a language model, or the error in its place. It never holds the key.

    Attributes:
        text: what the model wrote; None where ``error`` is set.
        error: None, or one of ``ERRORS``: the deadline passed; no connection, or an error of the server;
            the model or a filter refused to answer; a reply that is not a chat completion.
        detail: one line about the error, and about fields that were left out.
        raw: the body as JSON, or as truncated text if it is not JSON; None without a body.
        model: the model that answered, as the server reports it.
        tokens_in, tokens_out: tokens of the request and the answer, as the server counts them.
        seconds: from the question to the answer.
        sent: the body of the request, as it was last sent.
        dropped: the fields that were left out of it because the server refuses them.
        calls: number of requests.
        is_permanent: a retry cannot help: no server listens, the key or the address is refused, or a web
            page stands in place of an answer.
    """

    text: str | None = None
    error: str | None = None
    detail: str = ""
    raw: Any = None
    model: str | None = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    seconds: float = 0.0
    sent: Json = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    calls: int = 1
    is_permanent: bool = False


class Client:
    """Asks the model behind an endpoint. It may be copied and pickled.

    Args:
        endpoint: the server and the model.
        deadline_s: time for a question with all its retries; None: 30 s.

    Attributes:
        dropped: the fields that this server refused; they are not sent again.

    Raises:
        UserError: the ``openai`` package is not installed.
    """

    sleep = staticmethod(asyncio.sleep)

    def __init__(self, endpoint: Endpoint, deadline_s: float | None = None) -> None:
        require_extra("llm", "openai")
        _tls_context()  # imports the package, which takes a second that no deadline should have to cover
        self.endpoint, self.deadline_s = endpoint, deadline_s or DEADLINE_S
        self.dropped: set[str] = set()

    def request_body(
        self, messages: Sequence[dict[str, str]], seed: int, schema: Json | None = None
    ) -> dict[str, object]:
        """Return the body of a request; it depends on the arguments and the server's profile alone.

        Args:
            messages: the chat, each with ``role`` and ``content``.
            seed: sent where the profile says that the server knows seeds.
            schema: the JSON schema of the answer, sent in the profile's form.
        """
        server = self.endpoint.server
        body: dict[str, object] = {
            "model": self.endpoint.model,
            "messages": list(messages),
            "temperature": server.temperature,
            server.max_tokens_field: server.max_tokens,
        }
        if server.seed:
            body["seed"] = seed
        if schema is not None and server.response_format != "none":
            body["response_format"] = response_format(server.response_format, schema)
        return body

    async def complete(self, body: Json) -> Reply:
        """Ask a question; return a reply within the deadline, whatever the server does.

        A field that the server refuses is left out, now and from now on.
        """
        start = time.perf_counter()
        question = _Question(self, body)
        try:
            reply = await asyncio.wait_for(question.ask(), self.deadline_s)
        except TimeoutError:
            last = f", HTTP {question.status} before" if question.status else ""
            late = f"no answer within {self.deadline_s:g} s{last}; --deadline allows more"
            reply = Reply(error="timeout", detail=late)
        dropped = tuple(sorted(question.dropped))
        omitted = f"sent without {', '.join(dropped)}" if dropped else ""
        return replace(
            reply,
            detail="; ".join(filter(None, (reply.detail, omitted))),
            seconds=time.perf_counter() - start,
            sent=question.sent,
            dropped=dropped,
            calls=question.calls,
        )

    def complete_all(
        self,
        bodies: Sequence[Json],
        concurrency: int = 1,
        keep: Callable[[int, Reply], Any] = lambda index, reply: None,
    ) -> list[Reply]:
        """Ask several questions and wait for all; from any thread, and beside a running event loop.

        Args:
            bodies: of the requests.
            concurrency: number of questions under way at once.
            keep: called in another thread with each reply as soon as it arrives, and its index in ``bodies``.

        Returns:
            The replies in the order of ``bodies``.
        """
        future = asyncio.run_coroutine_threadsafe(self._gather(bodies, concurrency, keep), _event_loop())
        try:
            return future.result()
        except BaseException:  # Ctrl-C: give up what is under way
            future.cancel()
            raise

    async def _gather(
        self, bodies: Sequence[Json], concurrency: int, keep: Callable[[int, Reply], Any]
    ) -> list[Reply]:
        slots = asyncio.Semaphore(max(concurrency, 1))

        async def ask(index: int, body: Json) -> Reply:
            async with slots:
                reply = await self.complete(body)
            keep(index, reply)
            return reply

        return list(await asyncio.gather(*(ask(*pair) for pair in enumerate(bodies))))


class _Question:
    """All requests for one question, until there is a reply."""

    def __init__(self, client: Client, body: Json) -> None:
        self.client, self.body = client, body
        self.dropped = {name for name in client.dropped if name in body}
        self.sent: Json = {}
        self.calls = 0
        self.status: int | None = None  # of the last response
        self.is_busy = False  # the last response is a 429 that names no time to wait

    async def ask(self) -> Reply:
        import openai

        endpoint, waits = self.client.endpoint, iter(BACKOFF_S)
        async with self._connection() as api:
            while True:
                self.sent = {name: value for name, value in self.body.items() if name not in self.dropped}
                try:
                    response = await api.chat.completions.with_raw_response.create(**self.sent)
                    status, data = response.status_code, response.content
                except openai.APIStatusError as error:
                    status, data = error.status_code, error.response.content
                except openai.APITimeoutError:
                    raise TimeoutError from None
                except Exception as error:  # anything that a server makes the packages below raise
                    return _connection_failure(endpoint, error)
                reply = read_reply(status, data, endpoint.key, endpoint.server.refusal_codes)
                if reply.error == "http" and status in _REFUSING:
                    message = error_text(reply.raw)
                    if self._drop(message):
                        continue
                    reply = replace(reply, detail=f"{reply.detail}{self._length_advice(message)}")
                has_quota = "insufficient_quota" not in _codes(reply.raw)
                if self.is_busy and has_quota and (wait_s := next(waits, None)) is not None:
                    await self.client.sleep(wait_s)
                    continue
                if reply.error is None:
                    self._remember()
                return reply

    def _connection(self) -> Any:
        """Return the package's client, which takes nothing from the environment but proxies."""
        import openai

        for name in _WIRE_LOGS:  # they show headers that a server sends back, and it may send back the key
            logging.getLogger(name).setLevel(logging.WARNING)
        endpoint, timeout_s = self.client.endpoint, self.client.deadline_s
        http = openai.DefaultAsyncHttpxClient(
            event_hooks={"request": [self._restrict], "response": [self._read]},
            follow_redirects=False,  # the key goes to the server that it is for, and to no other
            trust_env=not endpoint.on_this_machine,  # a proxy has no way back to this machine
            timeout=timeout_s,
            verify=_tls_context(),
        )
        return openai.AsyncOpenAI(
            base_url=endpoint.base_url,
            api_key="none",
            max_retries=RETRIES,
            timeout=timeout_s,
            http_client=http,
        )

    async def _restrict(self, request: Any) -> None:
        """Count an ``httpx.Request``, and keep to the headers that it needs."""
        self.calls += 1
        for name in request.headers.keys() - _HEADERS:
            del request.headers[name]
        request.headers["Connection"] = "close"  # answers take seconds, and no socket is left open
        request.headers["Accept-Encoding"] = "identity"  # what is unpacked has no bound
        if self.client.endpoint.key:
            request.headers["Authorization"] = f"Bearer {self.client.endpoint.key}"

    async def _read(self, response: Any) -> None:
        """Read no more than ``LONGEST_BODY`` bytes of an ``httpx.Response``, and unpack nothing."""
        self.status, data = response.status_code, bytearray()
        async for part in response.stream:
            data += part[: LONGEST_BODY - len(data)]
            if len(data) >= LONGEST_BODY:
                break
        await response.stream.aclose()
        response.headers.pop("content-encoding", None)
        self.is_busy = self.status == 429 and not _WAIT_HEADERS & response.headers.keys()
        if self.is_busy:
            response.headers["x-should-retry"] = "false"  # the package gives up after two seconds
        response.stream = _http_package().ByteStream(bytes(data))

    def _drop(self, message: str) -> bool:
        """Leave out the next field that the server may have refused, the one that it names first."""
        left = [name for name in _OPTIONAL if name in self.sent]
        named = [name for name in left if any(word in message for word in _OPTIONAL[name])]
        is_length = any(word in message for word in _ABOUT_LENGTH)
        suspects = named or [name for name in left if name != "temperature" and not is_length]
        self.dropped.update(suspects[:1])
        return bool(suspects)

    def _length_advice(self, message: str) -> str:
        """Return what to do about an error that names the length of the answer or of the context."""
        if not any(word in message for word in _ABOUT_LENGTH):
            return ""
        server = self.client.endpoint.server
        sets = f"the profile {server.name} sets {server.max_tokens_field}: {server.max_tokens}"
        return f"; {sets}; pass --server FILE.yml with another max_tokens or max_tokens_field"

    def _remember(self) -> None:
        for name in self.dropped - self.client.dropped:
            self.client.dropped.add(name)
            _logger.warning("%s refuses %s; it is left out", self.client.endpoint.base_url, name)


def _http_package() -> Any:
    """Return the HTTP package that ``openai`` stands on, which depends on its version."""
    import openai

    bases = openai.DefaultAsyncHttpxClient.__mro__
    module = next(base.__module__ for base in bases if base.__name__ == "AsyncClient")
    return importlib.import_module(module.partition(".")[0])


@functools.cache
def _tls_context() -> Any:
    """Return the TLS settings of all connections, which take a while to load."""
    importlib.import_module("openai.resources.chat")
    return _http_package().create_ssl_context()


def _connection_failure(endpoint: Endpoint, error: Exception) -> Reply:
    cause = error.__cause__ or error
    kind = type(cause).__name__
    message = redact(endpoint.key, f"{kind}: {cause}".rstrip(": "))
    detail = one_line(f"no answer from {endpoint.base_url}: {message}")
    return Reply(error="http", detail=detail, is_permanent=kind == "ConnectError")


def response_format(form: str, schema: Json) -> Json:
    """Return the field ``response_format`` of a request in a server profile's form."""
    if form == "json_schema":
        return {"type": form, "json_schema": {"name": "plan", "strict": True, "schema": schema}}
    return {"type": "json_object", **({"schema": schema} if form == "json_object_with_schema" else {})}


# One daemon thread with an event loop for all questions of a process: it does not hold up the process's end

_STARTING = threading.Lock()
_LOOP: tuple[asyncio.AbstractEventLoop, threading.Thread] | None = None


def _event_loop() -> asyncio.AbstractEventLoop:
    global _LOOP
    with _STARTING:
        if _LOOP is None or not _LOOP[1].is_alive():  # a forked process has its parent's loop, not its thread
            loop = asyncio.new_event_loop()
            thread = threading.Thread(target=loop.run_forever, name="fpg-bench-llm", daemon=True)
            thread.start()
            _LOOP = (loop, thread)
        return _LOOP[0]


# Reading of responses, good and bad


def read_reply(status: int, data: bytes, secret: str | None, refusal_codes: tuple[int | str, ...]) -> Reply:
    """Read a response of any kind.

    Args:
        status: of HTTP.
        data: the body.
        secret: the key, which must not stand in the reply.
        refusal_codes: the codes of errors that mean a refusal.
    """
    body = _read_body(data[:LONGEST_BODY].decode("utf-8", "replace"), secret)
    if status >= 300:
        reply = _failed(body, f"HTTP {status}{_ADVICE.get(status, '')}", refusal_codes)
        return replace(reply, is_permanent=(status in _PERMANENT or status < 400) and reply.error == "http")
    if not isinstance(body, dict):
        kind = _describe_body(data) if isinstance(body, str) else "other JSON"
        detail = f"the reply is not a chat completion but {kind}"
        return Reply(error="invalid", detail=detail, raw=body, is_permanent=kind == _WEB_PAGE)
    if not body.get("choices"):
        if body.get("error") or body.get("code"):
            return _failed(body, "an error in place of an answer", refusal_codes)
        return Reply(error="invalid", detail="the reply holds no choices", raw=body)
    return read_completion(body)


def read_completion(body: Json) -> Reply:
    """Read a chat completion: the first choice's text, or the reason that it has none."""
    choices, usage = body.get("choices"), _object(body.get("usage"))
    choice = _object(choices[0] if isinstance(choices, list) else None)
    message, finish = _object(choice.get("message")), choice.get("finish_reason")
    model = body.get("model")
    reply = Reply(
        raw=body,
        model=one_line(model) if isinstance(model, str) and model else None,
        tokens_in=_count(usage.get("prompt_tokens")),
        tokens_out=_count(usage.get("completion_tokens")),
    )
    if message.get("refusal") or finish == "content_filter":
        refusal = message.get("refusal") or "the server's filter held the answer back"
        return replace(reply, error="refused", detail=one_line(str(refusal)))
    text = _content(message.get("content"))
    if not text.strip():
        why = " (cut off at max_tokens)" if finish == "length" else ""
        return replace(reply, error="invalid", detail=f"the reply holds no text{why}")
    return replace(reply, text=text)


def redact(secret: str | None, text: str) -> str:
    """Return a text with the key struck out; very short keys are left.

    It may be written as it is, as JSON or an address writes it, with blanks between its letters, or in
    base64, also within a longer text.
    """
    if secret is None or len(secret) < SHORTEST_SECRET:
        return text
    letters = []
    for letter in secret:
        percent = "".join(f"%{byte:02x}" for byte in letter.encode())
        letters.append("|".join(map(re.escape, (percent, letter, json.dumps(letter)[1:-1]))))
    forms = [r"\s*".join(f"(?:{each})" for each in letters)]
    for before in range(3):  # bytes; the first and the last letter may also stand for a neighbour's bits
        coded = base64.b64encode(b"\0" * before + secret.encode()).decode().rstrip("=")
        coded = coded[before + (before > 0) : -1]
        forms.append("".join({"+": "[+-]", "/": "[/_]"}.get(letter, letter) for letter in coded))
    return re.sub("|".join(forms), "***", text, flags=re.IGNORECASE)


def one_line(text: str) -> str:
    """Return a text on one line, cut where it is long, without control characters of a terminal."""
    line = printable(" ".join(text[: 4 * _LONGEST_DETAIL].split()))
    return line if len(line) <= _LONGEST_DETAIL else f"{line[: _LONGEST_DETAIL - 1]}…"


def error_text(body: object) -> str:
    """Return a server's error message, from any of the common forms."""
    if not isinstance(body, dict):
        return "" if str(body).lstrip()[:1] == "<" else str(body or "")
    message = body.get("error") or body.get("detail") or body
    if isinstance(message, dict):
        message = message.get("message") or message
    return message if isinstance(message, str) else json.dumps(message)


def _read_body(text: str, secret: str | None) -> Any:
    """Return a body as JSON, else as text, without the key."""
    try:
        plain = json.dumps(read_plain(text, halves=True), ensure_ascii=False)  # shows a key that was escaped
        return read_plain(redact(secret, plain.encode("utf-8", "replace").decode()))
    except ValueError:
        return redact(secret, text)[:_LONGEST_RAW]


def _failed(body: object, problem: str, refusal_codes: tuple[int | str, ...]) -> Reply:
    message = error_text(body)
    error = "refused" if _codes(body) & set(refusal_codes) else "http"
    return Reply(error=error, detail=one_line(f"{problem}: {message}" if message else problem), raw=body)


def _codes(body: object) -> set[int | str]:
    """Return the codes of an error object, wherever they stand; numbers written as words are numbers."""
    outer = _object(body)
    codes = [str(part.get(key)) for part in (outer, _object(outer.get("error"))) for key in ("code", "type")]
    return {int(code) if code.isdecimal() and len(code) < 10 else code for code in codes}


def _describe_body(data: bytes) -> str:
    if len(data) >= LONGEST_BODY:
        return f"more than {LONGEST_BODY} bytes"
    if data.lstrip()[:1] == b"<":
        return _WEB_PAGE
    return "cut or broken JSON" if data.strip() else "empty"


def _content(content: object) -> str:
    """Return a message's content: a string, or its parts of text alone; no halves of letters."""
    if isinstance(content, list):
        texts = [part for part in content if isinstance(part, dict) and part.get("type", "text") in _TEXTS]
        content = "".join(str(part.get("text", "")) for part in texts)
    return content.encode("utf-8", "replace").decode() if isinstance(content, str) else ""


def _count(value: object) -> int | None:
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_TOKENS:
        return value
    return None


def _object(value: object) -> Json:
    return value if isinstance(value, dict) else {}
