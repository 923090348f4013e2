"""Small hands for the tests of the client: one that asks a server of the tests, and a question."""

from __future__ import annotations

from dataclasses import replace

from fpg_bench.planning.llm.client import Client
from fpg_bench.planning.llm.servers import Endpoint, load_server

KEY = "sk-0123456789abcdef"
TALK = [{"role": "user", "content": "Where to?"}]
SCHEMA = {"type": "object", "properties": {"x": {"type": "integer"}}, "required": ["x"]}


def client(url, server="generic", deadline_s=5.0, **settings):
    profile = replace(load_server(server), **settings)
    return Client(Endpoint(url, "some-model", KEY, profile), deadline_s)


def ask(asked, seed=7):
    (reply,) = asked.complete_all([asked.request_body(TALK, seed, SCHEMA)])
    return reply
