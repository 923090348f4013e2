"""A real server of a language model, one for all tests; and an environment that configures none."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from .real_server import LlamaServer


@pytest.fixture(scope="session")
def llama_server() -> Iterator[LlamaServer]:
    """A llama.cpp server on loopback: ``url`` and ``model``."""
    with LlamaServer() as server:
        yield server


@pytest.fixture(autouse=True)
def no_endpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the tests' own environment configures is left out."""
    for name in os.environ:
        if name.startswith(("FPG_LLM_", "OPENAI_")):
            monkeypatch.delenv(name)
