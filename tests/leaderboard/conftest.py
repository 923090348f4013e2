"""Boards on small panels, and policies that are played without a process each."""

import platformdirs
import pytest

from fpg_bench.leaderboard import host, submission
from tests.leaderboard import entering


@pytest.fixture(scope="session")
def small_panels(tmp_path_factory):
    return entering.make_panels(tmp_path_factory.mktemp("panels"))


@pytest.fixture
def board(tmp_path, small_panels, monkeypatch):
    """An empty board, whose tracks play small panels, and a cache of its own."""
    for key, panel in small_panels.items():
        monkeypatch.setitem(submission.PANELS, key, panel)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "cache")
    (tmp_path / "board" / "submissions").mkdir(parents=True)
    return tmp_path / "board"


@pytest.fixture
def in_process(monkeypatch):
    """Policies are played in this process; the class can be told to misbehave."""
    kind = type("Told", (entering.InProcess,), {})
    monkeypatch.setattr(host, "PolicyHost", kind)
    return kind
