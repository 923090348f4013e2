"""A real server of a language model, one for all tests; and an environment that configures none."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from .real_server import LlamaServer, write_model


@pytest.fixture(scope="session")
def llama_server() -> Iterator[LlamaServer]:
    """A llama.cpp server on loopback: ``url`` and ``model``."""
    with LlamaServer() as server:
        yield server


@pytest.fixture(scope="session")
def tiny_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The GGUF file of a tiny model."""
    file = tmp_path_factory.mktemp("models") / "tiny.gguf"
    write_model(file)
    return file


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
