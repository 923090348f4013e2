"""Boards on small fields, and policies that are played without a process each."""

from functools import cache

import platformdirs
import pytest

from fpg_bench.leaderboard import host, likeness
from fpg_bench.players import agent
from tests.leaderboard import entering

SEED = 7
traces_of = cache(likeness.shipped_traces)


@pytest.fixture
def small_fields(tmp_path, monkeypatch):
    """A folder in place of ``baselines``: tracks play small fields, and seasons can be closed in it."""
    folder = entering.make_fields(tmp_path / "baselines")
    monkeypatch.setattr(agent, "baselines_folder", lambda: folder)
    return folder


@pytest.fixture
def board(tmp_path, small_fields, monkeypatch):
    """An empty board, whose tracks play small fields, and a cache of its own.

    New entries are compared with the shipped agents on the same rounds, so that those are played once.
    """
    monkeypatch.setattr(likeness, "fresh_seed", lambda: SEED)
    monkeypatch.setattr(likeness, "shipped_traces", lambda *words: dict(traces_of(*words)))
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "cache")
    (tmp_path / "board" / "submissions").mkdir(parents=True)
    return tmp_path / "board"


@pytest.fixture
def in_process(monkeypatch):
    """Policies are played in this process; the class can be told to misbehave."""
    kind = type("Told", (entering.InProcess,), {})
    monkeypatch.setattr(host, "PolicyHost", kind)
    return kind
