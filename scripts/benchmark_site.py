"""Measure how long the leaderboard's site takes to build for many entries, and to show its first table.

    python scripts/benchmark_site.py [--entries 200] [--folder leaderboard]

Real submissions and results are copied under other names until there are so many of each kind in turn; the
board is made of them and built as a site, without simulating rounds to watch. Where Chromium and Playwright
are installed, the ranking is opened from the disk and timed.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.leaderboard.board import make_board
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.result import fingerprint, read_result, verified_result, write_result
from fpg_bench.leaderboard.site.build import build_site


def grow(source: Path, folder: Path, entries: int) -> None:
    """Make a leaderboard of ``entries`` entries by copying those of another."""
    models = [path for path in sorted(source.glob("results/*/*.jsonl")) if path.parent.name != "planner"]
    for number in range(entries):
        result = models[number % len(models)]
        track, slug = result.parent.name, f"entry-{number}"
        target = folder / "submissions" / track / slug
        shutil.copytree(source / "submissions" / track / result.stem, target)
        about = yaml.safe_load((target / "submission.yaml").read_text())
        about["name"] = f"{about['name'][:40]} {number}"
        (target / "submission.yaml").write_text(yaml.safe_dump(about))
        submission = load_submission(target)
        suites = submission.suites
        lines = [dataclasses.replace(line, entry=slug) for line in read_result(result, suites).records]
        copied = verified_result(slug, track, fingerprint(submission, suites), lines, suites)
        write_result(folder / "results" / track / f"{slug}.jsonl", copied)


def first_table(site: Path) -> dict[str, float] | None:
    """Return the milliseconds until the ranking is painted and loaded; None without Chromium."""
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if chromium is None:
        return None
    from playwright.sync_api import sync_playwright

    script = """() => new Promise(done => requestAnimationFrame(() => setTimeout(() => done({
        "first paint": performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? 0,
        "loaded": performance.getEntriesByType("navigation")[0].loadEventEnd,
        "rows": document.querySelectorAll("#ally table.board tbody tr").length}), 50)))"""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto((site / "ranking.html").as_uri())
        times: dict[str, float] = page.evaluate(script)
        browser.close()
    return times


def timed(what: str, do: Any) -> Any:
    """Call ``do`` and print the seconds that it took."""
    start, used = time.perf_counter(), time.process_time()
    result = do()
    wall, own = time.perf_counter() - start, time.process_time() - used
    print(f"{what:34} {wall:7.2f} s, of which this process computed {own:.2f} s")
    return result


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--entries", type=int, default=200)
    options.add_argument("--folder", type=Path, default=Path("leaderboard"))
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder, site = Path(temporary) / "leaderboard", Path(temporary) / "site"
        grow(asked.folder, folder, asked.entries)
        board = timed(f"ranks of {asked.entries} entries", lambda: make_board(folder))
        timed("site, into an empty folder", lambda: build_site(board, site))
        timed("site, built again", lambda: build_site(board, site))
        size = sum(file.stat().st_size for file in [site / "index.html", *(site / "static").glob("*")])
        print(f"{'front page, styles and scripts':34} {size / 1e6:7.2f} MB")
        print(f"{'ranking in Chromium, ms':34} {first_table(site) or 'chromium is not installed'}")


if __name__ == "__main__":
    main()
