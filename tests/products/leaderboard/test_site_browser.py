"""The site in headless Chromium, from the disk and from a local server."""

import json
import re
from itertools import combinations, pairwise

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe

from fpg_bench.evaluation.statistics import difference, pair_error, student_t
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.leaderboard.site.build import build_site
from tests.attacks.test_onnx_files import costly, unsized
from tests.policies import remembering, through
from tests.products.leaderboard.browsing import PHONE, WATCHED, build_small_site, expect, rounds, visits
from tests.products.leaderboard.example_board import example_board, small_zoo, with_link

pytestmark = pytest.mark.browser

ENTRIES = 27
NAMES = ("index", "ranking", "play", "try", "crossplay", "compare", "submit")
PAGES = (WATCHED, *(f"{name}.html" for name in NAMES))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site") / "a b#c"  # a path that addresses must escape
    build_small_site(folder, ENTRIES)
    return folder


@pytest.fixture(scope="module")
def small_site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    build_small_site(folder, 6)
    return folder


FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
# Where the page stands as it did a frame before.
AT_REST = "() => { const before = window.stoodAt; window.stoodAt = scrollY; return before === scrollY; }"


def column(page, index):
    """Return a column of the first table as it is sorted: keys, entries' names, or what is shown."""
    rows = page.locator("#ally table.board tbody tr:not([hidden])")
    return rows.evaluate_all(
        f"""rows => rows.map(row => row.cells[{index}])
            .map(cell => cell.dataset.v ?? (cell.querySelector("a") ?? cell).textContent)"""
    )


def test_tables_need_no_javascript(visit):
    page = visit(java_script_enabled=False)
    assert page.locator("#ally table.board tbody tr").count() == ENTRIES
    assert page.locator("#ally table.board tbody tr").last.is_visible()


@pytest.mark.parametrize(("size", "least", "wide"), [((1280, 800), 10, 170), ((390, 844), 5, 300)])
def test_the_first_screen_of_the_ranking_has_the_claim_and_its_rows(visit, size, least, wide):
    """On a desktop each entry has one line, however long its name is; on a phone a picture is below."""
    width, height = size
    page = visit(viewport={"width": width, "height": height})
    rows = page.locator("#ally table.board tbody tr:not([hidden])")
    boxes = rows.evaluate_all("rows => rows.map((row) => row.getBoundingClientRect().toJSON())")
    assert sum(box["bottom"] <= height for box in boxes) >= least
    assert page.locator("#ally .about").bounding_box()["y"] < boxes[0]["y"]
    assert width < 700 or max(box["height"] for box in boxes) < 40
    picture = rows.nth(1).locator(".interval").bounding_box()
    assert picture["width"] >= wide
    assert picture["x"] + picture["width"] <= width
    assert boxes[1]["top"] < picture["y"]
    assert picture["y"] + picture["height"] <= boxes[1]["bottom"]
    behind = rows.nth(1).locator("td").nth(2)
    assert re.fullmatch("[−+][\\d.]+ ?[−\\d.]+ to [−\\d.]+", behind.inner_text())
    assert behind.bounding_box()["x"] + behind.bounding_box()["width"] <= width


def test_a_column_is_sorted_both_ways_by_its_button(visit):
    page = visit()
    header = page.locator("#ally thead th").nth(2)
    first = page.locator("#ally thead th").nth(1)
    scores = [float(value) for value in column(page, 2)]
    assert (header.get_attribute("aria-sort"), scores) == ("descending", sorted(scores, reverse=True))
    header.locator("button").focus()
    page.keyboard.press("Enter")
    scores = [float(value) for value in column(page, 2)]
    assert (header.get_attribute("aria-sort"), scores) == ("ascending", sorted(scores))
    first.locator("button").click()
    assert (first.get_attribute("aria-sort"), header.get_attribute("aria-sort")) == ("ascending", "none")
    hostile = ["Player 0 <script>alert(1)</script>", 'Player 1 "><img src=x onerror=alert(2)>']
    assert column(page, 1)[:2] == hostile
    assert len(column(page, 1)) == 25
    page.get_by_role("button", name=f"Show all {ENTRIES}").click()
    assert len(column(page, 1)) == ENTRIES
    header.locator("button").click()
    assert column(page, 2)[-1] == ""  # what has no score is last, whichever way
    row = page.locator("#ally tr[data-unverified]")
    assert "not verified: seed_0: outran the limit" in row.inner_text()
    assert row.locator("td").first.inner_text() == "–"


def test_numbers_are_sorted_by_what_they_show_and_those_that_are_missing_stand_last(visit):
    page = visit()
    page.locator("#ally .sift summary").click()
    page.locator("#ally .columns").select_option("all")
    page.get_by_role("button", name=f"Show all {ENTRIES}").click()
    heads = page.locator("#ally thead th")
    index = next(k for k, text in enumerate(heads.all_inner_texts()) if text.startswith("Gap"))
    for sign in (1, -1):
        heads.nth(index).locator("button").click()
        *shown, last = column(page, index)
        gaps = [sign * float(text.replace("−", "-")) for text in shown]
        assert (gaps, last) == (sorted(gaps), "–")
        assert len(set(gaps)) > 2


def test_the_address_keeps_how_a_table_is_shown(visit):
    page = visit("ranking.html")
    extra = page.locator("#ally thead th.extra").first
    expect(extra).to_be_hidden()
    page.locator("#ally .sift summary").click()
    page.locator("#ally .columns").select_option("all")
    expect(extra).to_be_visible()
    page.locator("#ally thead th").nth(1).locator("button").click()
    page.locator("#ally .filter").fill("player 1")
    page.locator('#ally .kind[value="zoo"]').uncheck()
    shown, address = column(page, 1), page.url
    page.goto("about:blank")
    page.goto(address)
    assert column(page, 1) == shown
    expect(page.locator("#ally .filter")).to_be_visible()
    expect(page.locator("#ally .filter")).to_have_value("player 1")
    expect(page.locator("#opponent-pursuit .columns")).to_have_value("all")
    expect(page.locator("#ally thead th.extra").first).to_be_visible()


def test_filters_hide_rows_and_say_how_many_are_left(visit):
    page = visit()
    count = page.locator("#ally .count")
    page.locator("#ally .sift summary").click()
    page.locator("#ally .filter").fill("player 12")
    assert len(column(page, 1)) == 1
    assert count.inner_text() == f"1 of {ENTRIES} entries"
    page.locator("#ally .filter").fill("")
    page.locator('#ally .kind[value="script"]').uncheck()
    shown = page.locator("#ally .board tbody tr:not([hidden])")
    assert set(shown.evaluate_all("rows => rows.map(row => row.dataset.kind)")) == {"zoo", "submitted"}
    page.locator('#ally .kind[value="script"]').check()
    page.locator("#ally .unverified").uncheck()
    assert count.inner_text().startswith(f"{ENTRIES - 1} of {ENTRIES} entries")
    assert page.locator("#opponent-pursuit .board tbody tr:not([hidden])").count() == 2  # as it was


def test_two_entries_are_compared_and_the_address_keeps_which(visit, site):
    page = visit("compare.html")
    page.locator("#a").select_option("player-4")
    page.locator("#b").select_option("player-7")
    expect(page.locator("#verdict")).to_contain_text(
        re.compile("Player 4.*Player 7.*with 95 % those of all pairs hold together")
    )
    heads = page.locator("#comparison th.second").all_inner_texts()
    assert heads
    assert all(head.startswith("Player 7") for head in heads)
    address = page.url
    assert address.endswith("#track=ally&a=player-4&b=player-7")
    page.locator("#swap").click()
    assert page.locator("#a").input_value() == "player-7"
    page.goto("about:blank")
    page.goto(address)
    expect(page.locator("#a")).to_have_value("player-4")
    assert page.locator("#b").input_value() == "player-7"
    page.locator("#track").select_option("opponent-pursuit")
    page.wait_for_url("**#track=opponent-pursuit&a=player-*")
    expect(page.locator("#verdict")).to_contain_text("Player 1")
    headings = page.locator("#comparison h2").all_inner_texts()
    assert [heading.partition(":")[0] for heading in headings[:3]] == ["Public", "Held-out", "Shifted"]
    assert page.locator("#comparison svg").count() == 3 + 4 + 3  # all rivals, then each of them


# The page's difference of two entries.
DIFFERENCE = """([one, two, student]) => fpgDifferences.between(one, two, student)"""


def test_differences_and_their_intervals_are_those_of_the_tables(visit):
    """The page has Student's t of the track's pairs; the rest is the formula of the ranking."""
    page, rng = visit("compare.html"), np.random.default_rng(1)
    chance = rng.normal(50, 9, 40)
    samples = [chance + rng.normal(mean, 2, (seeds, 40)) for seeds, mean in ((5, 2), (3, 0), (1, 9))]
    error = pair_error(41)
    for one, two in combinations(samples, 2):
        expected = difference(one, two, error)
        by_match = [of.mean(axis=0).tolist() for of in (one, two)]
        found = page.evaluate(DIFFERENCE, [*by_match, student_t(40, error)])
        assert found == pytest.approx((expected.value, expected.half))
    assert page.evaluate(DIFFERENCE, [[1.0], [0.5], 9]) == [0.5, None]


def test_a_round_is_played_paused_and_scrubbed(visit):
    page = visit(WATCHED)
    step, button = page.locator("#replay-step"), page.locator("#replay-play")
    expect(step).to_have_attribute("max", "300")
    page.locator("#main").focus()
    page.keyboard.press("End")  # scrolls the page, as no player has the focus
    page.wait_for_function(AT_REST)
    assert 100 <= int(step.input_value()) < 150  # a moment at which something happens
    expect(page.locator("#replay-event")).to_have_text(re.compile(f"{step.input_value()} s: "))
    assert "step=" not in page.url
    assert page.locator("#round-summary").inner_text().startswith("Overlap ratio ")
    button.click()
    expect(step).not_to_have_value(re.compile("^[0-2]$"))
    button.click()
    at = int(step.input_value())
    assert at < 100  # it was played from its start
    page.evaluate(FRAMES)
    assert int(step.input_value()) == at
    step.focus()
    page.keyboard.press("End")
    expect(step).to_have_value("300")
    page.keyboard.press("Shift+ArrowLeft")
    expect(step).to_have_value("290")
    assert "290 / 300" in page.locator("#replay-figures").inner_text()
    step.fill("42")
    expect(page.locator("#replay-figures")).to_contain_text("42 / 300")


@pytest.fixture
def watched(visit):
    page = visit(WATCHED)
    expect(page.locator("#replay-step")).to_have_attribute("max", "300")
    return page


def starts(happens):
    """The steps in which something begins; none is in the round's start."""
    return [k for k in range(1, len(happens)) if happens[k] and not happens[k - 1]]


def test_events_are_those_of_the_data(watched):
    data = json.loads(rounds()[0].script.removeprefix("fpgRound(").removesuffix(");\n"))["replay"]
    scenario, steps = data["scenario"], data["rounds"][0]["steps"]
    events = watched.evaluate("replay => fpgEvents(replay.rounds[0], replay.scenario)", data)
    count = len(steps["snr"])
    jammed = [steps["covered"][k] and steps["snr"][k] < scenario["threshold_db"] for k in range(count)]
    near = [metres < scenario["distance_reward_m"] for metres in steps["distance"]]
    hopped = [k for k in range(1, count) if steps["hopped"][k]]
    covered = steps["covered"]
    anew = [
        k
        for k in range(1, count)
        if covered[k] and (not covered[k - 1] or steps["frequency"][k] != steps["frequency"][k - 1])
    ]
    expected = {"jammed": starts(jammed), "near": starts(near), "spread": starts(steps["spreading"])}
    expected["covered"] = [k for k in anew if not jammed[k]]
    for kind, begun in (expected | {"hopped": hopped}).items():
        assert [one["step"] for one in events if one["kind"] == kind] == begun, kind
    assert [one["step"] for one in events] == sorted(one["step"] for one in events)
    heard = [one["step"] for one in events if one["kind"] == "found"]
    assert heard
    assert all(steps["check"][k] == 1 for k in heard)
    assert watched.locator("#replay-story li").count() == len(events)


def test_an_event_is_announced_only_once_it_has_happened(watched):
    item = watched.locator("#replay-story li button").nth(3)
    step, text = re.fullmatch(r"(\d+) s: (.*)", item.text_content()).groups()
    marks = watched.locator("#replay-marks i:not([hidden])")
    watched.locator("#replay-step").fill(str(int(step) - 1))
    expect(watched.locator("#replay-event")).not_to_have_text(f"{step} s: {text}")
    expect(marks.nth(3)).not_to_be_attached()  # once the page has drawn the step
    before = marks.count()
    watched.locator("#replay-step").fill(step)
    expect(marks.nth(before)).to_be_attached()


def test_a_rival_s_row_leads_to_its_round(watched):
    watched.locator("button.round").nth(1).click()
    row = watched.locator("tr", has=watched.locator(".trail")).first
    row.locator("summary").click()
    row.get_by_role("link", name="watch it").click()
    expect(watched.locator("button.round").nth(0)).to_have_attribute("aria-pressed", "true")
    expect(watched.locator("#watch")).to_be_in_viewport()


def test_a_round_plays_alone_in_a_small_frame_again_and_again(visit):
    small = {"width": 480, "height": 270}
    page = visit(f"{WATCHED}#embed&play&loop&from=290", viewport=small)
    for name in ("title", "arena", "spectrum", "event", "play"):
        expect(page.locator(f"#replay-{name}")).to_be_in_viewport(ratio=1)
    for other in (".top", "h1", "#replay-snr", "#replay-figures"):
        expect(page.locator(other).first).to_be_hidden()
    assert page.evaluate("document.getElementById('replay').scrollHeight <= innerHeight")
    assert page.evaluate("getComputedStyle(document.documentElement).overflowY") == "hidden"
    expect(page.locator("#replay-event")).to_have_text(
        re.compile(r"The end: ally [+−][\d.]+ per step, opponent [+−][\d.]+; link broken \d+ % of the time")
    )
    expect(page.locator("#replay-event")).not_to_have_text(re.compile("The end"))  # it has begun again
    assert 290 <= int(page.locator("#replay-step").input_value()) < 300
    assert page.url.endswith("#embed&play&loop&from=290")


def test_labels_keep_clear_of_each_other(watched):
    for step in range(0, 301, 50):
        boxes = watched.evaluate(
            f"""async step => {{ const input = document.getElementById("replay-step"); input.value = step;
            input.dispatchEvent(new Event("input")); await {FRAMES};
            return document.getElementById("replay").fpgLabels(); }}""",
            step,
        )
        assert {box["text"].split(",")[0] for box in boxes} >= {"ally", "opponent"}
        for i, a in enumerate(boxes):
            for b in boxes[i + 1 :]:
                apart = a["right"] <= b["left"] or b["right"] <= a["left"]
                assert apart or a["bottom"] <= b["top"] or b["bottom"] <= a["top"], (step, a, b)


def test_no_word_of_a_panel_is_cut_at_its_edge(watched):
    drawn = watched.evaluate(
        f"""async () => {{
          const drawn = [], plain = CanvasRenderingContext2D.prototype.fillText;
          CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {{
            const size = this.measureText(text), wide = this.canvas.width / this.getTransform().a;
            drawn.push([text, x >= size.actualBoundingBoxLeft && x + size.actualBoundingBoxRight <= wide]);
            return plain.call(this, text, x, y);
          }};
          document.getElementById("replay-step").dispatchEvent(new Event("input"));
          await {FRAMES};
          CanvasRenderingContext2D.prototype.fillText = plain;
          return drawn;
        }}"""
    )
    assert {"╌ outage below 8 dB", "╌ near: within 30 m"} <= {text for text, _ in drawn}
    assert [text for text, is_whole in drawn if not is_whole] == []


def test_the_address_keeps_the_round_and_the_step(watched):
    watched.locator("button.round").nth(1).click()
    expect(watched.locator("button.round").nth(1)).to_have_attribute("aria-pressed", "true")
    watched.locator("#replay-step").fill("77")
    watched.wait_for_url("**#round=1&step=77")
    address = watched.url
    watched.goto("about:blank")
    watched.goto(address)
    expect(watched.locator("#replay-step")).to_have_value("77")
    expect(watched.locator("button.round").nth(1)).to_have_attribute("aria-pressed", "true")


def test_the_arena_turns_by_keys_and_lets_the_wheel_scroll_the_page(watched):
    picture = "document.getElementById('replay-arena').toDataURL()"
    watched.locator("#replay-arena").focus()
    before, step = watched.evaluate(picture), watched.locator("#replay-step").input_value()
    watched.keyboard.press("ArrowLeft")
    watched.wait_for_function(f"before => {picture} !== before", arg=before)
    assert watched.locator("#replay-step").input_value() == step
    box = watched.locator("#replay-arena").bounding_box()
    watched.mouse.move(box["x"] + 50, box["y"] + 50)
    at = watched.evaluate("scrollY")
    watched.mouse.wheel(0, 200)
    watched.wait_for_function("at => scrollY > at", arg=at)


def test_one_finger_on_the_arena_scrolls_the_page_and_two_turn_it(visit):
    page = visit(WATCHED, viewport=PHONE, has_touch=True, is_mobile=True)
    expect(page.locator("#replay-step")).to_have_attribute("max", "300")
    page.evaluate("document.querySelector('.plots').scrollIntoView()")
    box = page.locator("#replay-arena").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    picture = "document.getElementById('replay-arena').toDataURL()"
    before, at = page.evaluate(picture), page.evaluate("scrollY")
    fingers = page.context.new_cdp_session(page)

    def touch(kind, *points):
        event = {"type": kind, "touchPoints": [{"x": across, "y": down} for across, down in points]}
        fingers.send("Input.dispatchTouchEvent", event)

    touch("touchStart", (x, y))
    for moved in range(10, 100, 10):
        touch("touchMove", (x, y - moved))
    touch("touchEnd")
    page.wait_for_function("at => scrollY >= at + 40", arg=at)
    assert page.evaluate(picture) == before
    page.wait_for_function(AT_REST)  # it may glide on
    at, middle = page.evaluate("scrollY"), page.locator("#replay-arena").bounding_box()
    y = middle["y"] + middle["height"] / 2
    touch("touchStart", (x - 40, y), (x + 40, y))
    for moved in (30, 60):
        touch("touchMove", (x - 40 + moved, y), (x + 40 + moved, y))
    touch("touchEnd")
    page.wait_for_function(f"before => {picture} !== before", arg=before)
    assert abs(page.evaluate("scrollY") - at) <= 2  # the glide's last pixels


def test_the_theme_follows_the_system_until_it_is_switched_and_is_remembered(visit):
    page = visit(color_scheme="dark")
    scheme = "getComputedStyle(document.documentElement).colorScheme"
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert page.evaluate(scheme) == "dark"
    page.locator("#theme").click()
    assert page.evaluate(scheme) == "light"
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != dark
    with page.expect_navigation():
        page.get_by_role("link", name="Submit", exact=True).click()
    assert page.evaluate(scheme) == "light"


def test_a_cell_of_cross_play_has_a_label_and_plays_a_round(visit):
    page = visit("crossplay.html")
    cell = page.locator("#heatmap a").first
    label = cell.get_attribute("aria-label")
    assert re.search(r"ally's return −?\d+\.\d\d ± 1\.25|ally's return −?\d+\.\d\d,", label)
    assert "jamming success rate" in label
    cell.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == label
    page.keyboard.press("Enter")
    page.wait_for_url("**/play.html#side=nobody*")
    expect(page.locator("#clock")).not_to_have_text("0 / 300")
    assert page.locator("#rival").evaluate("box => box.selectedOptions[0].text") == "tone"


def drawn(page):
    """The matrix shown, row by row, and its caption."""
    numbers = page.evaluate(
        """() => { const number = (cell) => Number(cell.textContent.replace("−", "-").replace(" %", ""));
        return [...document.querySelectorAll("#heatmap tbody tr")].map(
            (row) => [...row.querySelectorAll("b")].map(number)); }"""
    )
    return numbers, page.locator("#heatmap caption").inner_text()


def test_each_matrix_of_cross_play_is_shown_with_the_strongest_first(visit):
    page = visit("crossplay.html")
    page.wait_for_selector("#heatmap td")
    page.locator("#who").select_option(label=page.locator("#who option").nth(3).inner_text())
    player = page.locator("#who").evaluate("box => box.selectedOptions[0].text")
    for matrix, caption, sign in (
        ("ally", "ally's return", -1),
        ("opponent", "opponent's return", 1),
        ("jamming_success_rate", "jamming success rate", 1),
    ):
        page.locator("#matrix").select_option(matrix)
        values, heading = drawn(page)
        assert heading == f"{caption} of each pair"
        allies = [sign * sum(row) / len(row) for row in values]
        opponents = [-sign * sum(column) / len(column) for column in zip(*values, strict=True)]
        rounding = 1.0 if matrix == "jamming_success_rate" else 0.1  # as cells are written
        for means in (allies, opponents):
            assert all(one <= other + rounding for one, other in pairwise(means))
        assert page.locator("#who").evaluate("box => box.selectedOptions[0].text") == player
    page.reload()
    assert page.locator("#matrix").input_value() == "jamming_success_rate"


@pytest.mark.parametrize("asked", ["__proto__", "toString", "nothing"])
def test_a_matrix_that_there_is_not_is_the_first(visit, asked):
    page = visit(f"crossplay.html#matrix={asked}")
    page.wait_for_selector("#heatmap td")
    assert page.locator("#matrix").input_value() == "ally"
    assert drawn(page)[1] == "ally's return of each pair"


def test_a_link_leads_to_the_cross_play_of_the_other_scenario_whose_rounds_are_played_by_its_rules(
    browser, tmp_path
):
    with small_zoo():
        build_site(with_link(example_board(4, season=2), season=2), tmp_path)
    with visits(browser, tmp_path) as go:
        page = go("crossplay.html")
        expect(page.locator("#heatmap a").first).to_be_visible()
        page.get_by_role("link", name="link", exact=True).click()
        page.wait_for_url("**/crossplay-link.html")
        expect(page.locator("#heatmap td").first).to_be_visible()
        href = page.locator("#heatmap a").first.get_attribute("href")
        labels = page.locator("#heatmap tbody th").all_inner_texts()
        assert len(labels) == 4
        assert all(label.endswith(" on a link") for label in labels)
        expect(page.locator("#value")).to_have_text("0.50")
        assert page.locator("nav a[aria-current]").all_inner_texts() == ["Cross-play"]
        assert not violations(page)
        page.goto(f"{tmp_path.as_uri()}/{href}")
        expect(page.locator("#game")).to_have_value("link")
        expect(page.locator("#clock")).not_to_have_text("0 / 300")


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_a_visitor_plays_a_round_of_the_radio_link(visit, side):
    rival = {"ally": "opponent=script:adaptive", "opponent": "ally=script:expert"}[side]
    page = visit(f"play.html#side={side}&game=link&{rival}&seed=4&seconds=60")
    expect(page.locator("#clock")).to_have_text("0 / 60")
    assert page.locator("#type option").all_inner_texts() == list(JAMMING_TYPES)
    if side == "ally":
        expect(page.locator("#costs")).to_contain_text("a hop 0.3 s of the link")
    for _ in range(60):
        page.keyboard.press("n")
    expect(page.locator("#event")).to_have_text(re.compile(r"The round is over: [\d.−]+ per second"))
    assert "game=link" in page.locator("#link").inner_text()
    earned = float(page.locator("#earned").inner_text().replace("−", "-"))
    assert -3 < earned < 10.1  # at most the utility of the highest rate


def numbers(text: str) -> list[float]:
    """The numbers in a text of a page."""
    return [float(number.replace("−", "-")) for number in re.findall(r"−?\d[\d.]*", text)]


def violations(page, impacts=("serious", "critical"), **options) -> list:
    """Violations of these impacts that axe finds on a page."""
    # Preloading would fetch styles again, which the pages forbid.
    options |= {"preload": False, "resultTypes": ["violations"]}
    rules = Axe().run(page, options=options).response["violations"]
    return [
        (rule["id"], [node["html"][:200] for node in rule["nodes"][:3]])
        for rule in rules
        if rule["impact"] in impacts
    ]


# Of less than serious impact.
STRUCTURE = ["landmark-unique", "empty-table-header"]


@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_serious(visit, small_site, name):
    page = visit(name, origin=small_site.as_uri(), color_scheme="light")  # axe looks at each of the cells
    assert not violations(page)
    assert not violations(page, ("moderate", "minor"), runOnly={"type": "rule", "values": STRUCTURE})
    page.emulate_media(color_scheme="dark")  # the same but for its colours
    assert not violations(page, runOnly={"type": "rule", "values": ["color-contrast"]})
    if name == "crossplay.html":  # a large one scrolls
        focus = {"type": "rule", "values": ["scrollable-region-focusable"]}
        assert not violations(visit(name), runOnly=focus)


def test_an_entry_is_printed_on_two_pages(visit):
    printed = visit(WATCHED).pdf(format="A4")
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) <= 2


# The relative luminance of two colours by their names in the style, as WCAG 2.2 has it.
CONTRAST = """([line, ground]) => {
  const style = getComputedStyle(document.documentElement);
  const luminance = (name) => {
    const colour = style.getPropertyValue(name).trim();
    const parts = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);
    const [r, g, b] = parts.map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const [dark, light] = [luminance(line), luminance(ground)].sort((a, b) => a - b);
  return (light + 0.05) / (dark + 0.05);
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_line_has_a_contrast_of_three_to_one(visit, scheme):
    page = visit(color_scheme=scheme)
    for line in ("line", "grey", "ink", "ally", "opponent"):
        for ground in ("page", "panel", "ground"):
            assert page.evaluate(CONTRAST, [f"--{line}", f"--{ground}"]) >= 3, (line, ground)
    strokes = page.evaluate(
        """[...document.querySelectorAll(".interval *")].map((line) => getComputedStyle(line).stroke)"""
    )
    pale = page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--pale').trim()")
    assert strokes
    assert "rgb({}, {}, {})".format(*bytes.fromhex(pale[1:])) not in strokes


def test_marks_of_the_mean_leave_its_interval_visible(visit):
    page = visit()
    for dot, line, width in page.locator("#ally .interval").evaluate_all(
        """pictures => pictures.map((one) => [one.querySelector(".dot").getAttribute("d"),
        Number(/^M[-\\d.]+ (\\d+)H/.exec(one.querySelector(".range").getAttribute("d"))[1]),
        parseFloat(getComputedStyle(one.querySelector(".range")).strokeWidth)])"""
    ):
        top, above, gap = map(float, re.fullmatch(r"M[\d.]+ (\d+)v(\d+)m0 (\d+)v\d+", dot).groups())
        assert top + above <= line - width / 2
        assert top + above + gap >= line + width / 2


def test_a_page_is_printed_in_light_colours_without_bars(visit):
    page = visit(color_scheme="dark")
    page.locator("#theme").click()
    page.locator("#theme").click()  # dark by choice, too
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    for bar in (".top", ".tools"):
        expect(page.locator(bar).first).to_be_hidden()
    assert page.locator(".scroll").first.evaluate("box => getComputedStyle(box).overflowX") == "visible"


def test_no_page_scrolls_sideways_on_a_phone(visit, site):
    page = visit(viewport=PHONE)
    for name in PAGES:
        page.goto(f"{site.as_uri()}/{name}")
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= PHONE["width"], name
        for link in page.locator("nav a").all():
            box = link.bounding_box()
            assert box["x"] >= 0, name
            assert box["x"] + box["width"] <= PHONE["width"], name


def test_the_skip_link_comes_first_and_leads_to_the_content(visit):
    page = visit()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"


SCREENS = {"phone": PHONE, "desktop": {"width": 1440, "height": 900}}


@pytest.mark.parametrize("screen", SCREENS)
def test_the_first_screen_holds_the_moving_game_its_buttons_and_the_leaders(visit, screen):
    page = visit("index.html", viewport=SCREENS[screen])
    places = [page.locator("#film canvas"), *page.locator("a.button").all(), page.locator(".about")]
    assert len(places) == 5
    for place in places:
        box = place.bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= SCREENS[screen]["height"]


# Within a second and a half.
MOVED = """async () => { const picture = () => document.querySelector("#film canvas").toDataURL();
const before = picture(), end = performance.now() + 1500;
while (picture() === before && performance.now() < end) await new Promise(done => setTimeout(done, 50));
return picture() !== before; }"""


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_the_round_moves_until_it_is_stopped_or_where_motion_is_wanted(visit, motion):
    page = visit("index.html", reduced_motion=motion)
    expect(page.locator("#film .caption")).to_contain_text("s: ")
    if motion == "reduce":
        assert not page.evaluate(MOVED)
    else:
        page.locator("#film .pause").click()
        assert not page.evaluate(MOVED)
        page.locator("#film .pause").click()
        assert page.evaluate(MOVED)


PRESSED = """async () => {  // a key while a second is played counts for nothing
  const said = (id) => document.getElementById(id).textContent;
  for (let k = 0; k < 3000 && !said("result") && !said("event").startsWith("The round is over"); k++) {
    document.activeElement.dispatchEvent(new KeyboardEvent("keydown", { key: "n", bubbles: true }));
    await new Promise((done) => setTimeout(done));
  }
}"""


def begin(page, side, **settings):
    """Begin a round as a side against the first script of the other one."""
    page.locator("#side").select_option(side)
    for name, value in settings.items():
        page.locator(f"#{name}").select_option(value)
    page.locator("#seed").press("Enter")
    expect(page.locator("#one")).to_be_visible()
    page.locator("#one").focus()


# The example's board has no table of opponents that fly themselves, and so no scale for a visitor who is one.
@pytest.mark.parametrize(("side", "ending"), [("ally", r", a score of [\d.−]+; 0"), ("opponent", r"\.$")])
def test_the_keyboard_plays_a_round(visit, side, ending):
    page = visit("play.html")
    begin(page, side)
    page.keyboard.press("n")
    page.evaluate(PRESSED)
    expect(page.locator("#event")).to_have_text(re.compile(r"The round is over: [\d.−]+ per second" + ending))
    expect(page.locator("#clock")).to_have_text("300 / 300")
    expect(page.locator("#one")).to_be_hidden()


RINGED = """() => [...document.querySelectorAll("#hands button:focus-visible")].map((one) => one.id)"""


def test_a_ring_is_the_keyboard_s(visit):
    page = visit("index.html")
    page.get_by_role("link", name="Play a minute").click()
    expect(page.locator("#run")).to_have_text("❚❚ pause")
    assert page.evaluate(RINGED) == []
    hop = page.locator("#hop")
    assert hop.evaluate("hop => getComputedStyle(hop).outlineStyle") == "none"
    page.keyboard.press("Tab")
    hop.focus()
    assert page.evaluate(RINGED) == ["hop"]
    assert hop.evaluate("hop => getComputedStyle(hop).outlineStyle") == "solid"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("side=ally&opponent=script:nobody&quick", "opponent “script:nobody”"),
        ("side=sideways", "side “sideways”"),
        ("side=opponent&ally=script:idle&seed=x", "seed “x”"),
    ],
)
def test_a_wrong_link_gets_one_line_and_starts_nothing(visit, words, said):
    page = visit(f"play.html#{words}")
    expect(page.locator("#event")).to_contain_text(f"This link does not work here: {said} is unknown.")
    expect(page.locator("#hands")).to_be_hidden()
    expect(page.locator("#setup")).to_be_visible()


def test_the_page_opens_with_a_round_that_waits(visit):
    page = visit("play.html")
    expect(page.locator("#event")).to_contain_text("waits")
    expect(page.locator("#clock")).to_have_text("0 / 300")
    drawn = """() => { const canvas = document.getElementById("arena");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return new Set(data).size > 9; }"""
    page.wait_for_function(drawn)
    assert "#" not in page.url


def test_a_visiting_opponent_learns_the_link_and_the_score_at_the_end(visit):
    page = visit("play.html")
    begin(page, "opponent", rival="script:expert-spread", seconds="60")
    events = set()
    for _ in range(59):
        page.keyboard.press("n")
        events.add(page.locator("#event").inner_text().partition(": ")[2])
    assert all(re.match("The opponent (hears|is within)|$", event) for event in events)
    assert len(events) > 2
    expect(page.locator("#snr")).to_be_hidden()
    for name in ("score", "earned"):
        expect(page.locator(f"#{name}")).to_have_text("at the end")
    page.keyboard.press("n")
    expect(page.locator("#snr")).to_be_visible()
    expect(page.locator("#earned")).to_have_text(re.compile(r"[\d.−]+"))


def test_keys_can_be_switched_off(visit):
    page = visit("play.html")
    begin(page, "ally")
    page.locator("#keys").uncheck()
    for key in "hsn":
        page.keyboard.press(key)
    expect(page.locator("#clock")).to_have_text("0 / 300")
    expect(page.locator("#hop")).to_have_attribute("aria-pressed", "false")
    page.locator("#keys").check()
    page.keyboard.press("h")
    expect(page.locator("#hop")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("n")
    expect(page.locator("#clock")).to_have_text("1 / 300")
    expect(page.locator("#hop")).to_have_attribute("aria-pressed", "false")  # for one second


def test_spreading_has_a_price_that_grows_while_it_lasts(visit):
    page = visit("play.html")
    begin(page, "ally")
    page.locator("#spread").click()
    expect(page.locator("#costs")).to_have_text("a hop 40; spreading now 0.5 a second")
    for _ in range(14):
        page.keyboard.press("n")
    expect(page.locator("#costs")).to_have_text("a hop 40; spreading now 10.0 a second")


def test_a_minute_begins_at_once_and_ends_with_the_leader_and_random_on_its_seed(visit):
    page = visit("index.html", viewport=PHONE)
    page.get_by_role("link", name="Play a minute").click()
    expect(page.locator("#run")).to_have_text("❚❚ pause")
    expect(page.locator("#hop")).to_be_in_viewport(ratio=1)
    expect(page.locator("#score")).to_be_in_viewport(ratio=1)
    assert page.locator("#hop").bounding_box()["height"] >= 44
    page.evaluate(PRESSED)
    result = page.locator("#result")
    expect(result).to_have_text(re.compile(r"You −?\d+, the leader \d+, random −?\d+"))
    expect(page.locator("#link")).to_contain_text("Beat me: ")
    first, address = result.inner_text(), page.locator("#link").inner_text()
    page.goto("about:blank")
    page.goto(address.partition("Beat me: ")[2])  # a friend gets the same minute, and a score to beat
    expect(page.locator("#goal")).to_contain_text(
        "The score to beat is " + re.search(r"You (−?\d+)", first)[1].replace("−", "-")
    )
    expect(page.locator("#setup")).to_be_hidden()
    expect(page.locator("#run")).to_have_text("❚❚ pause")
    page.evaluate(PRESSED)
    expect(result).to_have_text(re.compile(re.escape(first.partition(", ")[2])))
    page.locator("#watch").click()
    expect(page.locator("#replay-step")).to_have_attribute("max", "60")
    expect(page.locator("#replay-title")).to_have_text("you against watchful")


@pytest.mark.parametrize("button", ["hop", "spread", "run"])
def test_a_phone_shows_the_buttons_of_a_full_round(visit, button):
    page = visit("play.html", viewport=PHONE)
    begin(page, "ally")
    expect(page.locator(f"#{button}")).to_be_in_viewport(ratio=1)


def test_a_race_has_the_leader_beside_the_visitor_and_a_line_to_share(visit):
    page = visit("index.html")
    page.get_by_role("link", name="Race the leader").click()
    expect(page.locator("#race-spectrum")).to_be_visible()
    expect(page.locator("#race-score")).to_have_text(re.compile(r"−?\d+"))
    assert int(re.search(r"seed=(\d+)", page.url)[1]) == page.evaluate("Math.floor(Date.now() / 86400000)")
    page.evaluate(PRESSED)
    shared = page.locator("#link")
    expect(shared).to_have_text(
        re.compile(r"^I −?\d+, the leader −?\d+, random −?\d+\. Beat me: file.*race=&beat=−?\d+$")
    )
    raced = page.locator("#race-score").inner_text()
    assert f"the leader {raced}," in shared.inner_text()  # both played the leader's round


CHAMPION = "agents/ally-champion/ppo-stack8/seed_0/policy.onnx"  # the page has it as a script, too


def give(page, data):
    page.locator("#policy").set_input_files({"name": "mine.onnx", "mimeType": "", "buffer": data})


def test_a_policy_file_scores_as_the_page_s_own_version_of_the_agent(visit):
    page = visit("try.html")
    with page.expect_download() as sample:
        page.get_by_role("link", name="Take this ally").click()
    assert sample.value.path().read_bytes() == (baselines_folder() / CHAMPION).read_bytes()
    page.locator("#policy").set_input_files(baselines_folder() / CHAMPION)
    expect(page.locator("#status")).to_contain_text("an unofficial score of")
    rows = page.locator("#table tbody tr").evaluate_all(
        "rows => rows.map(row => [...row.cells].map(cell => cell.textContent))"
    )
    assert len(rows) == 9  # all, and each script
    assert all(score == own for _, score, _, _, own in rows)
    worst = page.locator("#round option").first.inner_text()
    rival, points = re.fullmatch(r"(.*), seed \d: (.*)", worst).groups()
    assert f"worst against {rival}, {points} on seed" in page.locator("#status").inner_text()
    expect(page.locator("#replay-title")).to_have_text(f"policy.onnx against {rival}")
    expect(page.locator("#replay-step")).to_have_attribute("max", "300")
    page.locator("#round").select_option(index=1)
    expect(page.locator("#replay-title")).to_have_text(re.compile("policy.onnx against"))
    assert not violations(page)


def test_a_policy_file_that_cannot_be_played_gets_one_line(visit):
    from onnx import helper, load_model

    page, path = visit("try.html"), baselines_folder() / CHAMPION
    data = path.read_bytes()
    status = page.locator("#status")
    for broken in (b"", b"no model", data[: len(data) // 2], data[:-1]):
        give(page, broken)
        expect(status).to_have_text("This is not an ONNX file, or it is truncated.")
    give(page, data + bytes(5_000_001))
    expect(status).to_have_text(re.compile("larger than 5 MB"))
    model = load_model(path)
    model.graph.node.extend([helper.make_node("Loop" * 250_000, ["action"], ["b"])])
    give(page, model.SerializeToString())
    expect(status).to_have_text(re.compile("cannot play the operator (Loop){10}…; a submission may not"))
    give(page, remembering(activations=["Sigmoid", "Tanh", "Tanh"]))
    expect(status).to_have_text("Operator LSTM: its attribute activations is not played.")
    expect(page.locator("#scores")).to_be_hidden()


def test_no_file_stops_the_page(visit):
    page, told = visit("try.html"), re.compile("multiply-adds|not played|cannot|too long|computed in play")
    for data in (costly() | unsized()).values():
        page.locator("#status").evaluate("element => (element.textContent = '')")
        give(page, data)
        expect(page.locator("#status")).to_have_text(told)


def test_an_answer_that_is_no_action_loses_the_round_as_on_the_board(visit):
    page = visit("try.html")
    give(page, through("Identity", scale=1e30))
    expect(page.locator("#status")).to_contain_text("an unofficial score of −100.0 over 40 rounds")
    expect(page.locator("#status")).to_contain_text("It loses 40 of them by an answer that is no action.")


def test_a_policy_file_can_be_dropped(visit):
    page = visit("try.html")
    page.locator("#drop").evaluate(
        """zone => { const data = new DataTransfer(); data.items.add(new File(["x"], "dropped.onnx"));
        zone.dispatchEvent(new DragEvent("drop", { dataTransfer: data, cancelable: true })); }"""
    )
    expect(page.locator("#status")).to_have_text("This is not an ONNX file, or it is truncated.")
