"""The built site of the documentation, in a browser."""

import csv
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from tests.products.leaderboard.browsing import chromium
from tests.programs import ROOT

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PAGES = (
    "index",
    "start/first-game",
    "reference/rules",
    "reference/glossary",
    "reference/generated/AllyVsScripted-v0",
    "reference/generated/gallery",
    "reference/generated/quick_start",
    "results/regimes",
    "search",
    "genindex",
)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder of the site, built as ``make docs`` does: warnings are errors."""
    site = tmp_path_factory.mktemp("docs") / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", ROOT / "docs", site]
    made = subprocess.run(command, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return site


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture
def visit(browser, built):
    page = browser.new_page()
    yield lambda place: page.goto(f"{built.as_uri()}/{place}") and page
    page.close()


def test_the_first_page_loads_less_than_400_kb(browser, built):
    page, loaded = browser.new_page(), []
    page.on("request", lambda request: loaded.append(request.url))
    page.goto(f"{built.as_uri()}/index.html", wait_until="load")
    page.close()
    files = {Path(unquote(urlsplit(url).path)) for url in loaded if url.startswith("file:")}
    assert any(path.name == "game.png" for path in files)
    assert sum(path.stat().st_size for path in files) < 400_000


@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_on_the_pages(visit, name):
    found = Axe().run(visit(f"{name}.html"), options={"resultTypes": ["violations"]}).response["violations"]
    assert [(rule["id"], [node["html"][:200] for node in rule["nodes"][:3]]) for rule in found] == []


@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("overlap ratio", "reference/measures"),
        ("install", "start/install"),
        ("learning curve", "guides/training"),
        ("submit an agent", "benchmark/submitting"),
        ("confidence interval", "benchmark/protocol"),
        ("leaderboard", "benchmark/leaderboard"),
        ("best response", "guides/selfplay"),
        ("language model", "guides/planners"),
        ("discrete actions", "environments/discrete-actions"),
        ("quick start", "start/first-game"),
        ("exploitability", "results/champions"),
    ],
)
def test_the_search_shows_what_people_look_for_first(visit, words, page):
    first = visit(f"search.html?q={words.replace(' ', '+')}").locator("#search-results li > a").first
    assert re.sub(r"\.html.*", "", first.get_attribute("href", timeout=60_000)) == page


def test_the_front_has_code_and_game_side_by_side_and_the_code_is_copied(visit):
    front = visit("index.html").locator(".front")
    code, game = (front.locator(part).bounding_box() for part in ("pre", "img"))
    assert code["x"] + code["width"] <= game["x"]
    assert max(box["y"] + box["height"] for box in (code, game)) < 720
    front.get_by_role("button", name="copy").click()
    expect(front.get_by_role("button")).to_have_text("copied")


def test_films_move(visit):
    frame = visit("reference/generated/gallery.html").locator(".film").first
    frame.scroll_into_view_if_needed()
    film = frame.content_frame
    film.get_by_role("button", name="play").click()
    expect(film.get_by_role("button", name="pause")).to_be_visible()


def test_the_outputs_of_notebooks_are_shown(visit):
    drawn = visit("reference/generated/quick_start.html").locator("article img")
    assert drawn.count() == 4
    assert drawn.evaluate_all("all => all.every((one) => one.naturalWidth > 300)")


def test_a_radio_on_the_map_gets_the_measured_points_around_it(visit):
    form = visit("results/regimes.html").locator("#radio")
    radio, *numbers = form.locator("select, input").all()
    said = form.locator("output")
    assert len(radio.locator("option").all()) == 6
    expect(said).to_have_text(re.compile(r"nearest point, \(0\.3, 4, \+3 dB\): hop 15 .* spread 3 "))
    radio.select_option(label="Link 16 (fast hopper, military), L")
    assert [number.input_value() for number in numbers[:2]] == ["0.51", "77"]
    expect(said).to_have_text(re.compile("lies beyond the map"))
    for number, value in zip(numbers, ("0.4", "3", "6"), strict=True):
        number.fill(value)
    with (ROOT / "docs/results/regimes.csv").open() as file:
        values = {
            f"({row['hop_dwell']}, {row['reaction_dwell']}, +{float(row['power_dbm']) - 36:g} dB)": row[
                "value"
            ]
            for row in csv.DictReader(file)
        }
    shown = {row.split("\t")[0]: row.split("\t")[1] for row in form.locator("tbody tr").all_inner_texts()}
    near = ((2, 3), (4, 3), (4, 9))
    assert shown.keys() == {f"({hop}, {at}, +{power} dB)" for hop in (0.3, 0.5) for at, power in near}
    assert all(value.startswith(f"{float(values[point]):.2f} [") for point, value in shown.items())


def test_every_link_of_the_site_leads_to_a_place_on_a_page(built):
    texts = {path: path.read_text() for path in built.rglob("*.html")}
    places = {path: set(re.findall(r' (?:id|name)="([^"]+)"', text)) for path, text in texts.items()}
    dead = []
    for path, text in texts.items():
        for link in set(re.findall(r'href="([^":]*)"', text)):
            name, _, anchor = unquote(link).partition("#")
            target = (path.parent / name.partition("?")[0]).resolve() if name else path
            known = not anchor or anchor in places[target] if target in places else target.is_file()
            if not known and "board/" not in name:  # the board is built beside
                dead.append((path.relative_to(built).as_posix(), link))
    assert len(texts) > 100
    assert dead == []
