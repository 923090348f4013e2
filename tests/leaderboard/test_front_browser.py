"""The front page's first screen, and a visitor's round, in a real browser."""

import re

import pytest

from tests.leaderboard import test_site_browser as pages
from tests.leaderboard.test_site_browser import PHONE, browser, site, visit  # noqa: F401

pytestmark = pytest.mark.browser
expect = pages.expect
SCREENS = [PHONE, {"width": 1440, "height": 900}]


@pytest.mark.parametrize("screen", SCREENS, ids=["phone", "desktop"])
def test_the_first_screen_holds_the_moving_game_and_the_first_three(visit, screen):  # noqa: F811
    page = visit("index.html", viewport=screen)
    places = [page.locator("#film canvas"), *page.locator("article").first.locator("li").all()]
    assert len(places) == 4
    for place in places:
        box = place.bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= screen["height"]


# Within a second and a half.
MOVED = """async () => { const picture = () => document.querySelector("#film canvas").toDataURL();
const before = picture(), end = performance.now() + 1500;
while (picture() === before && performance.now() < end) await new Promise(done => setTimeout(done, 50));
return picture() !== before; }"""


def test_the_round_moves_until_it_is_stopped(visit):  # noqa: F811
    page = visit("index.html")
    expect(page.locator("#film .caption")).to_contain_text("s: ")
    page.locator("#film .pause").click()
    assert not page.evaluate(MOVED)
    page.locator("#film .pause").click()
    assert page.evaluate(MOVED)


def test_where_motion_is_not_wanted_it_is_a_still(visit):  # noqa: F811
    page = visit("index.html", reduced_motion="reduce")
    expect(page.locator("#film .caption")).to_contain_text("s: ")
    assert not page.evaluate(MOVED)


# The example's board has no table of opponents that fly themselves, and so no scale for a visitor who is one.
@pytest.mark.parametrize(("side", "told"), [("ally", r", a score of [\d.−]+; 0"), ("opponent", r"\.$")])
def test_the_keyboard_plays_a_whole_round(visit, side, told):  # noqa: F811
    page = visit("play.html")
    page.locator("#side").select_option(side)
    page.locator("#seed").press("Enter")
    expect(page.locator("#one")).to_be_enabled()
    page.locator("#one").focus()
    for _ in range(300):
        page.keyboard.press("n")
    expect(page.locator("#event")).to_have_text(re.compile(r"The round is over: [\d.−]+ per step" + told))
    expect(page.locator("#clock")).to_have_text("300 / 300")
    expect(page.locator("#one")).to_be_disabled()
