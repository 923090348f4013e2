"""Boards on small suites, and policies that are played without a process each."""

import platformdirs
import pytest

from fpg_bench.players import agent
from fpg_bench.products.sandbox import client
from tests.products.leaderboard import entering


@pytest.fixture
def small_suites(tmp_path, monkeypatch):
    """A folder in place of ``baselines``: tracks play small suites, and seasons can be closed in it."""
    folder = entering.make_suites(tmp_path / "baselines")
    monkeypatch.setattr(agent, "baselines_folder", lambda: folder)
    return folder


@pytest.fixture
def board(tmp_path, small_suites, monkeypatch):
    """An empty board with a cache of its own, whose tracks play small suites."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "cache")
    (tmp_path / "board" / "submissions").mkdir(parents=True)
    return tmp_path / "board"


@pytest.fixture
def in_process(monkeypatch):
    """Policies are played in this process; the class can be told to misbehave."""
    kind = type("PolicyClient", (entering.InProcess,), {})
    monkeypatch.setattr(client, "PolicyClient", kind)
    return kind


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Folder for the board that a module's tests begin with, which is played once."""
    return tmp_path_factory.mktemp("kept") / "board"


@pytest.fixture(scope="module")
def browser():
    from tests.products.leaderboard.browsing import chromium

    with chromium() as chromium_browser:
        yield chromium_browser


@pytest.fixture
def visit(browser, site):
    """Open pages of the module's site; see ``browsing.visits``."""
    from tests.products.leaderboard.browsing import visits

    with visits(browser, site) as go:
        yield go
