"""Trying an endpoint: what it honours of what an OpenAI-compatible server may be asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from fpg_bench.common.strict_json import read_plain
from fpg_bench.planning.llm.client import Client
from fpg_bench.planning.llm.replies import Reply, one_line
from fpg_bench.planning.llm.servers import SERVERS, Endpoint, Server, load_server

SHORT_DEADLINE_S = 0.01
FEW_TOKENS = 5
LOWEST, HIGHEST = 101, 109
SCHEMA = {
    "type": "object",
    "properties": {"number": {"type": "integer", "minimum": LOWEST, "maximum": HIGHEST}},
    "required": ["number"],
    "additionalProperties": False,
}
_HELLO = "Say hello in one short sentence. Do not write any digit or any bracket."
_DIGITS = "Write thirty random digits, separated by spaces, and nothing else."
_SEA = "Tell a long story about the sea."


@dataclass(frozen=True)
class Finding:
    """One thing that was tried: what; whether it is as one would wish, None: not known; what was seen."""

    what: str
    ok: bool | None
    detail: str


def probe(
    endpoint: Endpoint,
    deadline_s: float | None = None,
    progress: Callable[[Finding], None] = lambda finding: None,
) -> list[Finding]:
    """Try an endpoint with about ten short questions.

    Args:
        endpoint: whom to ask.
        deadline_s: how long each question may take; None: as the endpoint says.
        progress: called with each finding as soon as it is there.

    Returns:
        What was found; where the first question gets no answer, that alone. The last one says which
        settings a profile of this server should have.
    """
    found = []
    for finding in _findings(endpoint, deadline_s):
        progress(finding)
        found.append(finding)
    return found


def _findings(endpoint: Endpoint, deadline_s: float | None) -> Iterator[Finding]:
    first = _ask(endpoint, deadline_s, _HELLO)
    if first.error is not None:
        yield Finding("answer", False, f"{first.error}: {first.detail}")
        return
    yield Finding("answer", True, f"{one_line(first.text or '')!r} after {first.seconds:.2f} s")
    yield _model(endpoint, first)
    yield _tokens(first)
    yield _length(_ask(_with(endpoint, max_tokens=FEW_TOKENS), deadline_s, _SEA))
    yield _unknown_model(_ask(replace(endpoint, model="no-such-model"), deadline_s, _HELLO))
    yield _deadline(_ask(endpoint, SHORT_DEADLINE_S, _SEA))
    seed = _seed([_ask(_with(endpoint, seed=True), deadline_s, _DIGITS, seed) for seed in (1, 1, 2)])
    yield seed
    best = "none"
    for form in ("json_schema", "json_object_with_schema"):
        reply = _ask(_with(endpoint, response_format=form), deadline_s, _HELLO, schema=SCHEMA)
        finding = _enforced(form, reply)
        yield finding
        if finding.ok:
            best = form
            break
    yield _settings(endpoint.server, endpoint.server.seed if seed.ok is None else seed.ok, best)


def _ask(endpoint: Endpoint, deadline_s: float | None, text: str, seed: int = 0, schema: Any = None) -> Reply:
    client = Client(endpoint, deadline_s)
    messages = [{"role": "user", "content": text}]
    return client.complete_all([client.request_body(messages, seed, schema)])[0]


def _with(endpoint: Endpoint, **settings: Any) -> Endpoint:
    return replace(endpoint, server=replace(endpoint.server, **settings))


def _model(endpoint: Endpoint, reply: Reply) -> Finding:
    if reply.model is None:
        return Finding("model", None, f"asked for {endpoint.model}; the reply names none")
    return Finding("model", True, f"asked for {endpoint.model}, answered by {reply.model}")


def _tokens(reply: Reply) -> Finding:
    if reply.tokens_in is None or reply.tokens_out is None:
        return Finding("tokens", False, "not reported: a cap on tokens has no effect")
    return Finding("tokens", True, f"reported: {reply.tokens_in} in, {reply.tokens_out} out")


def _length(reply: Reply) -> Finding:
    """Whether max_tokens holds. A model that thinks may use it up before it says anything."""
    if reply.error is not None and reply.tokens_out is None:
        return Finding("max_tokens", None, f"{reply.error}: {reply.detail}")
    if reply.tokens_out is not None:
        seen = f"{reply.tokens_out} tokens written where {FEW_TOKENS} were allowed"
        ok = reply.tokens_out <= 2 * FEW_TOKENS
        few = "; servers count a few more or less" if ok and reply.tokens_out > FEW_TOKENS else ""
        return Finding("max_tokens", ok, seen + few)
    words = len((reply.text or "").split())
    return Finding(
        "max_tokens", words <= 2 * FEW_TOKENS, f"{words} words where {FEW_TOKENS} tokens were allowed"
    )


def _unknown_model(reply: Reply) -> Finding:
    if reply.error is None:
        return Finding("errors", None, "a model that does not exist answers: check which one is served")
    return Finding("errors", reply.error == "http", f"for an unknown model, {reply.error}: {reply.detail}")


def _deadline(reply: Reply) -> Finding:
    seen = "ended" if reply.error == "timeout" else "answered or failed"
    late = reply.seconds > SHORT_DEADLINE_S + 1
    return Finding("deadline", not late, f"{seen} after {reply.seconds:.2f} s, allowed {SHORT_DEADLINE_S} s")


def _seed(replies: list[Reply]) -> Finding:
    if any("seed" in reply.dropped for reply in replies):
        return Finding("seed", False, "refused")
    for reply in replies:
        if reply.error is not None:
            return Finding("seed", None, f"{reply.error}: {reply.detail}")
    first, again, other = (reply.text for reply in replies)
    if first != again:
        return Finding("seed", False, "ignored: the same seed gave two texts")
    if first == other:
        return Finding("seed", None, "no effect to be seen: every seed gives the same text")
    return Finding("seed", True, "honoured: the same seed gave the same text, another seed another")


def _enforced(form: str, reply: Reply) -> Finding:
    if "response_format" in reply.dropped:
        return Finding(form, False, "refused")
    if reply.error is not None:
        return Finding(form, None, f"{reply.error}: {reply.detail}")
    if _keeps_schema(reply.text or ""):
        return Finding(form, True, "enforced")
    return Finding(form, False, f"ignored: the answer was {one_line(reply.text or '')[:60]!r}")


def _keeps_schema(text: str) -> bool:
    try:
        answer = read_plain(text)
    except ValueError:
        return False
    number = answer.get("number") if isinstance(answer, dict) and len(answer) == 1 else None
    return type(number) is int and LOWEST <= number <= HIGHEST


def _settings(server: Server, seed: bool, form: str) -> Finding:
    """What a profile should say, and which ones do."""
    best = f"seed: {str(seed).lower()}, response_format: {form}"
    if (server.seed, server.response_format) == (seed, form):
        return Finding("profile", True, f"{best}, as {server.name} has it")
    profiles = map(load_server, SERVERS)
    fitting = [other.name for other in profiles if (other.seed, other.response_format) == (seed, form)]
    choose = f"set FPG_LLM_SERVER to one of {', '.join([*fitting, 'a YAML file of your own'])}"
    return Finding("profile", None, f"{best} would suit, {server.name} has it otherwise: {choose}")
