"""Probe of an endpoint: whether it answers, and which profile suits its server."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from fpg_bench.common.strict_json import read_plain
from fpg_bench.products.language_models.client import Client, Reply, one_line
from fpg_bench.products.language_models.servers import SERVERS, Endpoint, load_server

_HELLO = "Say hello in one short sentence. Do not write any digit or any bracket."
_DIGITS = "Write thirty random digits, separated by spaces, and nothing else."
_LOWEST, _HIGHEST = 101, 109
_SCHEMA = {
    "type": "object",
    "properties": {"number": {"type": "integer", "minimum": _LOWEST, "maximum": _HIGHEST}},
    "required": ["number"],
    "additionalProperties": False,
}


@dataclass(frozen=True)
class Finding:
    """One finding of a probe.

    Attributes:
        subject: what was tried.
        ok: it is as wanted; None: unknown.
        detail: the observation, in one line.
    """

    subject: str
    ok: bool | None
    detail: str


def probe(endpoint: Endpoint, deadline_s: float | None = None) -> Iterator[Finding]:
    """Ask an endpoint up to six short questions.

    Args:
        endpoint: the server and the model.
        deadline_s: for each question; None: the endpoint's.

    Yields:
        Findings: the answer (alone, where there is none), the tokens it counts, whether it honours a seed
        and enforces a schema, and the profile to choose.
    """
    hello = _ask(endpoint, deadline_s, _HELLO)
    if hello.error is not None:
        yield Finding("answer", False, f"{hello.error}: {hello.detail}")
        return
    by = f" by {hello.model}" if hello.model else ""
    yield Finding("answer", True, f"{one_line(hello.text or '')!r}{by} after {hello.seconds:.2f} s")
    if hello.tokens_in is None or hello.tokens_out is None:
        yield Finding("tokens", False, "not reported: a cap on tokens has no effect")
    else:
        yield Finding("tokens", True, f"reported: {hello.tokens_in} in, {hello.tokens_out} out")
    seed = _seed([_ask(endpoint, deadline_s, _DIGITS, number, seed=True) for number in (1, 1, 2)])
    yield seed
    best = "none"
    for form in ("json_schema", "json_object_with_schema"):
        finding = _schema(form, _ask(endpoint, deadline_s, _HELLO, response_format=form))
        yield finding
        if finding.ok:
            best = form
            break
    yield _profile(endpoint, endpoint.server.seed if seed.ok is None else seed.ok, best)


def _ask(endpoint: Endpoint, deadline_s: float | None, text: str, number: int = 0, **settings: Any) -> Reply:
    server = endpoint.server.model_copy(update=settings)
    client = Client(replace(endpoint, server=server), deadline_s)
    schema = _SCHEMA if "response_format" in settings else None
    body = client.request_body([{"role": "user", "content": text}], number, schema)
    return client.complete_all([body])[0]


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
        return Finding("seed", None, "no visible effect: every seed gives the same text")
    return Finding("seed", True, "honoured: the same seed gave the same text, another seed another")


def _schema(form: str, reply: Reply) -> Finding:
    if "response_format" in reply.dropped:
        return Finding(form, False, "refused")
    if reply.error is not None:
        return Finding(form, None, f"{reply.error}: {reply.detail}")
    try:
        answer = read_plain(reply.text or "")
    except ValueError:
        answer = None
    number = answer.get("number") if isinstance(answer, dict) and len(answer) == 1 else None
    if type(number) is int and _LOWEST <= number <= _HIGHEST:
        return Finding(form, True, "enforced")
    return Finding(form, False, f"ignored: the answer was {one_line(reply.text or '')[:60]!r}")


def _profile(endpoint: Endpoint, seed: bool, form: str) -> Finding:
    """Return the settings that suit the server, and the profiles that have them."""
    server, best = endpoint.server, f"seed: {str(seed).lower()}, response_format: {form}"
    if (server.seed, server.response_format) == (seed, form):
        return Finding("profile", True, f"{best}, as {server.name} has it")
    profiles = map(load_server, SERVERS)
    fitting = [other.name for other in profiles if (other.seed, other.response_format) == (seed, form)]
    choose = f"set FPG_LLM_SERVER to one of {', '.join([*fitting, 'a YAML file of your own'])}"
    return Finding("profile", None, f"{best} would suit, {server.name} has it otherwise: {choose}")
