"""A real server of a language model, one for all tests; and an environment that configures none."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from .playing import KEY
from .real_server import LlamaServer


@pytest.fixture(scope="session")
def llama_server() -> Iterator[LlamaServer]:
    """A llama.cpp server on loopback: ``url`` and ``model``."""
    with LlamaServer() as server:
        yield server


@pytest.fixture(autouse=True)
def no_endpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clear the endpoint that the tests' own environment configures."""
    for name in os.environ:
        if name.startswith(("FPG_LLM_", "OPENAI_")):
            monkeypatch.delenv(name)


@pytest.fixture(autouse=True)
def quick_retries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the openai package wait a tenth of its time before a retry."""
    from openai import _base_client

    monkeypatch.setattr(_base_client, "INITIAL_RETRY_DELAY", 0.05)


@pytest.fixture
def asks(monkeypatch):
    """Return a function that points the environment's endpoint at a server."""

    def point(server):
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "toy")
        monkeypatch.setenv("FPG_LLM_API_KEY", KEY)

    return point


@pytest.fixture
def file(tmp_path):
    return tmp_path / "somewhere" / "match.jsonl"
