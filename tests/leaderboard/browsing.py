"""The browser of the tests: Chromium without a window. Its headless shell shows the same in half the time."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
if CHROMIUM is None and not os.environ.get("CI"):
    pytest.skip("Chromium is not installed; .ci/run installs its headless shell", allow_module_level=True)

from playwright.sync_api import Browser, sync_playwright  # noqa: E402


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser, and its end."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()
