"""Take screenshots of the leaderboard's front page for the docs, on a desktop and on a phone.

fpg-bench leaderboard build
python scripts/make_board_pictures.py leaderboard/site docs
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

PICTURES = {"leaderboard.png": (1440, 900), "leaderboard-phone.png": (390, 844)}


def main(site: Path, folder: Path) -> None:
    """Take a screenshot of the front page at each size, without animations."""
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name, (width, height) in PICTURES.items():
            page = browser.new_page(
                viewport={"width": width, "height": height}, reduced_motion="reduce", color_scheme="light"
            )
            page.goto((site / "index.html").absolute().as_uri())
            page.wait_for_timeout(500)
            page.screenshot(path=folder / name)
        browser.close()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
