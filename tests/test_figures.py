"""The committed figures as a browser shows them: by day, by night, and in grey."""

import io
import re
import subprocess

import numpy as np
import pytest
from PIL import Image

from fpg_bench.common.canvas import _DARK_INKS, ALLY, COLOURS, OPPONENT
from tests.products.leaderboard.browsing import chromium
from tests.programs import ROOT

FIGURES = subprocess.check_output(["git", "ls-files", "docs/*.svg"], cwd=ROOT, text=True).split()
GROUNDS = {"light": (255, 255, 255), "dark": (13, 17, 23)}
# Grounds, frames, and text on the cells of an image, which stay as they are
APART = ("#ffffff", "#f1f4f8", "#cdd3db", "#010101", "white")
# What a caption or a legend tells apart by colour, in figures whose names begin with a pattern
NAMED = {
    "docs/results/value": (COLOURS[2], COLOURS[4]),
    "docs/results/paper/figures/fig[3467]": (ALLY, OPPONENT),
    "docs/results/fig7": (ALLY, OPPONENT),
    "docs/pictures/waterfall": ("#053061", OPPONENT),
}
MARKS = """apart => [...document.querySelectorAll("path, use, text")].filter(mark => {
  const style = mark.getAttribute("style") ?? "";
  return !mark.closest("defs, clipPath") && ![...apart, "opacity"].some(word => style.includes(word));
}).flatMap(mark => {
  const shown = getComputedStyle(mark);
  const drawn = mark.tagName === "text" ? "fill:" : mark.getAttribute("style") ?? "";
  return ["fill", "stroke"].filter(kind => drawn.includes(`${kind}:`)).map(kind => shown[kind]);
}).filter(colour => colour.startsWith("rgb("))"""


ON_CELLS = """() => [...document.querySelectorAll("text")].filter((text) => {
  const { x, y, right, bottom } = text.getBoundingClientRect();
  return [...document.querySelectorAll("image")].map((image) => image.getBoundingClientRect())
    .some((cells) => cells.x <= x && right <= cells.right && cells.y <= y && bottom <= cells.bottom);
}).map((text) => getComputedStyle(text).fill)"""


def luminance(colour):
    """The relative luminance of WCAG 2: what is left of a colour in grey."""
    part = np.array(colour) / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def rgb(colour):
    return tuple(bytes.fromhex(colour[1:]))


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened


@pytest.mark.slow
@pytest.mark.parametrize("scheme", GROUNDS)
def test_the_marks_of_every_figure_stand_out_from_the_page(browser, scheme):
    page = browser.new_page(color_scheme=scheme)
    faint = set()
    for figure in FIGURES:
        page.goto((ROOT / figure).as_uri())
        colours = {tuple(map(int, colour[4:-1].split(","))) for colour in page.evaluate(MARKS, APART)}
        assert colours
        faint |= {(figure, colour) for colour in colours if contrast(colour, GROUNDS[scheme]) < 2}
    assert not faint


@pytest.mark.slow
def test_text_on_the_cells_of_an_image_is_the_same_by_night(browser):
    inks = {}
    for scheme in GROUNDS:
        page = browser.new_page(color_scheme=scheme)
        for figure in (figure for figure in FIGURES if "<image" in (ROOT / figure).read_text()):
            page.goto((ROOT / figure).as_uri())
            inks.setdefault(figure, []).append(page.evaluate(ON_CELLS))
    assert sum(bool(day) for day, _ in inks.values()) >= 2
    assert [figure for figure, (day, night) in inks.items() if day != night] == []


@pytest.mark.slow
def test_what_a_caption_names_by_colour_is_told_apart_in_grey_and_by_night(browser):
    page = browser.new_page(color_scheme="light", viewport={"width": 1100, "height": 700})
    for begins, colours in NAMED.items():
        assert contrast(*map(rgb, colours)) > 1.25
        assert contrast(*(rgb(_DARK_INKS.get(colour, colour)) for colour in colours)) > 1.25
        shown = [figure for figure in FIGURES if re.match(begins, figure)]
        assert shown
        for figure in shown:
            page.goto((ROOT / figure).as_uri())
            pixels = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
            for colour in colours:
                assert (abs(pixels - rgb(colour)).max(axis=-1) < 12).any(), (figure, colour)
