"""Make the pictures of the documentation: a round as a film and a still, and screenshots of the leaderboard.

python scripts/make_pictures.py docs/pictures
python scripts/make_pictures.py docs/pictures --site leaderboard/site
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from command import run
from PIL import Image

from fpg_bench import make_duel
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.products.rendering.film import write_gif
from fpg_bench.products.rendering.picture import Picture
from fpg_bench.products.rendering.recording import Recording

STEPS, SEED = 170, 12
EVERY = 3  # steps per frame
PLOTS = (522, 94, 1120, 640)  # of a frame: left, top, right and bottom, in pixels; a phone shows them legibly
NIGHT = (13, 17, 23)  # GitHub's ground
SCREENS = {"leaderboard.png": (1440, 900), "leaderboard-phone.png": (390, 844)}


class DarkPicture(Picture):
    """The same by night: light is dark and dark light, of the same hue, down to the page's ground."""

    def draw(self, step: int | None = None) -> np.ndarray:
        """Return the picture after a step."""
        image = super().draw(step).astype(int)
        turned = image + (255 - image.max(axis=-1) - image.min(axis=-1))[..., None]
        night: np.ndarray = np.maximum(turned, NIGHT).astype(np.uint8)
        return night


def make_film(path: Path) -> None:
    """Film the first steps of a round of expert-spread against adaptive, by day and by night.

    The still beside each film, a PNG, has the plots of its last frame.
    """
    duel = make_duel(1)
    ally, opponent = (
        PolicyRunner(side, [as_player(name, side, duel.scenario)], duel.batch)
        for side, name in (("ally", "expert-spread"), ("opponent", "adaptive"))
    )
    mask = duel.reset(seeds=SEED)
    ally.begin(mask)
    opponent.begin(mask)
    recording = Recording(duel.batch, 0)
    for _ in range(STEPS):
        duel.batch.step(ally.act(), opponent.act())
        recording.add()
    for of, picture in ((path, Picture), (path.with_stem(f"{path.stem}-dark"), DarkPicture)):
        write_gif([recording], of, every=EVERY, picture=picture)
        plots = Image.fromarray(picture(recording).draw()).crop(PLOTS)
        plots.quantize(128).save(of.with_suffix(".png"), optimize=True)


def take_screenshots(site: Path, folder: Path) -> None:
    """Take screenshots of a built site's front page at each size, without animations."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name, (width, height) in SCREENS.items():
            page = browser.new_page(
                viewport={"width": width, "height": height}, reduced_motion="reduce", color_scheme="light"
            )
            page.goto((site / "index.html").absolute().as_uri())
            page.wait_for_timeout(500)
            page.screenshot(path=folder / name)
        browser.close()


def main(folder: Path, site: Path | None = None) -> None:
    """Make the film, or screenshots of a site."""
    if site is None:
        make_film(folder / "game.gif")
    else:
        take_screenshots(site, folder)


if __name__ == "__main__":
    run(main)
