"""Fixtures of the tests of matches and of comparisons of planners."""

from __future__ import annotations

import os

import pytest


@pytest.fixture
def file(tmp_path):
    return tmp_path / "somewhere" / "match.jsonl"


@pytest.fixture
def asks(monkeypatch):
    """Clear the endpoint of the environment; return a function that points it at a server."""
    from tests.products.language_models.playing import KEY

    for name in os.environ:
        if name.startswith("FPG_LLM_"):
            monkeypatch.delenv(name)

    def point(server):
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "toy")
        monkeypatch.setenv("FPG_LLM_API_KEY", KEY)

    return point
