"""The browser of the tests: Chromium without a window. Its headless shell shows the same in half the time."""

from __future__ import annotations

import functools
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fpg_bench.evaluation.suite import load_suite
from fpg_bench.products.leaderboard.site.build import build_site
from fpg_bench.products.leaderboard.site.replays import Replay, simulate_round
from fpg_bench.products.leaderboard.submission import Submission
from tests.products.leaderboard.example_board import HOSTILE, example_board, small_zoo, with_entry

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
if CHROMIUM is None and not os.environ.get("CI"):
    pytest.skip("Chromium is not installed; .ci/run installs its headless shell", allow_module_level=True)

from playwright.sync_api import Browser, Page, expect, sync_playwright  # noqa: E402

WATCHED, FOLDER = "entries/ally/player-3.html", "replays/ally/player-3"
PATIENCE_MS = 60_000  # a browser on a busy machine is slow
PHONE = {"width": 390, "height": 844}
DESKTOP = {"width": 1280, "height": 900}
SEVERE = ("error", "warning")
expect.set_options(timeout=PATIENCE_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser, and its end."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@functools.cache
def rounds() -> list[Replay]:
    """Two rounds of a script, under a name that tries to become markup."""
    submission = Submission.model_construct(
        folder=Path("player-3"), track="ally", name=HOSTILE[0], script="expert-spread"
    )
    suite = load_suite("ally-v2")
    return [
        simulate_round(submission, "expert-spread", suite, rival, f"against {rival.name}", f"{FOLDER}/{k}.js")
        for k, rival in enumerate(suite.rivals[:2])
    ]


def build_small_site(folder: Path, entries: int) -> None:
    """Build a site with two agents of the zoo, one the leader of many, two rounds, and a past season."""
    board = example_board(entries, hostile=True, season=2)
    for entry in (entry for entry in board.tracks[0].entries if entry.slug == "player-8"):
        about = entry.about.model_copy(update={"script": None, "zoo": "ally-champion/ppo-stack8"})
        board = with_entry(board, entry.slug, about=about)
    with small_zoo():
        build_site(board, folder, {("ally", "player-3"): rounds()})


@contextmanager
def visits(browser: Browser, site: Path) -> Iterator[Callable[..., Page]]:
    """Open pages; afterwards no console message, alert or request of another host may have occurred."""
    contexts, complaints = [], []

    def go(name="ranking.html", origin=None, viewport=DESKTOP, **options):
        context = browser.new_context(viewport=viewport, **options)
        contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        home = origin or site.as_uri()

        def route(route, request):
            ours = request.url.startswith((home, "data:", "blob:"))
            if not ours:
                complaints.append(f"asks for {request.url}")
            route.continue_() if ours else route.abort()

        context.route("**/*", route)
        page = context.new_page()
        page.on(
            "console", lambda message: complaints.append(message.text) if message.type in SEVERE else None
        )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: (complaints.append(f"alert {dialog.message}"), dialog.dismiss()))
        page.goto(f"{home}/{name}")
        return page

    yield go
    for context in contexts:
        context.close()
    assert not complaints
