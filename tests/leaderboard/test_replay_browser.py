"""The replay in a real browser: its events, its camera, its address, and the page that it leaves alone."""

import json
import re

import pytest

from tests.leaderboard.browsing import PHONE, WATCHED, build_small_site, expect, rounds

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    build_small_site(folder, 4)
    return folder


@pytest.fixture
def watched(visit):
    page = visit(WATCHED)
    expect(page.locator("#replay-step")).to_have_attribute("max", "300")
    return page


def starts(happens):
    """The steps in which something begins; none is in the round's start."""
    return [k for k in range(1, len(happens)) if happens[k] and not happens[k - 1]]


def test_events_are_those_of_the_data(watched):
    first, _ = rounds()
    data = json.loads(first.script.removeprefix("fpgRound(").removesuffix(");\n"))["replay"]
    scenario, steps = data["scenario"], data["rounds"][0]["steps"]
    events = watched.evaluate("replay => fpgEvents(replay.rounds[0], replay.scenario)", data)
    count = len(steps["snr"])
    jammed = [steps["covered"][k] and steps["snr"][k] < scenario["threshold_db"] for k in range(count)]
    near = [metres < scenario["distance_reward_m"] for metres in steps["distance"]]
    steps_by_kind = {
        kind: [one["step"] for one in events if one["kind"] == kind]
        for kind in ("jammed", "near", "spread", "hopped")
    }
    assert steps_by_kind == {
        "jammed": starts(jammed),
        "near": starts(near),
        "spread": starts(steps["spreading"]),
        "hopped": [k for k in range(1, count) if steps["hopped"][k]],
    }
    assert [one["step"] for one in events] == sorted(one["step"] for one in events)
    heard = [one["step"] for one in events if one["kind"] == "found"]
    assert heard
    assert all(steps["check"][k] == 1 for k in heard)
    assert watched.locator("#replay-story li").count() == len(events)


def test_an_event_is_announced_only_once_it_has_happened(watched):
    item = watched.locator("#replay-story li button").nth(3)
    step, text = re.fullmatch(r"(\d+) s: (.*)", item.text_content()).groups()
    watched.locator("#replay-step").fill(str(int(step) - 1))
    expect(watched.locator("#replay-event")).not_to_have_text(f"{step} s: {text}")
    marks = watched.locator("#replay-marks i:not([hidden])").count()
    assert marks <= 3
    watched.locator("#replay-step").fill(step)
    expect(watched.locator("#replay-marks i:not([hidden])").nth(marks)).to_be_attached()


def test_labels_keep_clear_of_each_other(watched):
    for step in range(0, 301, 20):
        boxes = watched.evaluate(
            """async step => { const root = document.getElementById("replay");
            const input = document.getElementById("replay-step"); input.value = step;
            input.dispatchEvent(new Event("input"));
            await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
            return root.fpgLabels(); }""",
            step,
        )
        assert {box["text"].split(",")[0] for box in boxes} >= {"ally", "opponent"}
        for i, a in enumerate(boxes):
            for b in boxes[i + 1 :]:
                apart = a["right"] <= b["left"] or b["right"] <= a["left"]
                assert apart or a["bottom"] <= b["top"] or b["bottom"] <= a["top"], (step, a, b)


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
    before = watched.evaluate(picture)
    watched.keyboard.press("ArrowLeft")
    watched.wait_for_timeout(200)
    assert watched.evaluate(picture) != before
    assert watched.locator("#replay-step").input_value() == "0"
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
    page.wait_for_timeout(300)  # it may glide on
    at, middle = page.evaluate("scrollY"), page.locator("#replay-arena").bounding_box()
    y = middle["y"] + middle["height"] / 2
    touch("touchStart", (x - 40, y), (x + 40, y))
    for moved in (30, 60):
        touch("touchMove", (x - 40 + moved, y), (x + 40 + moved, y))
    touch("touchEnd")
    page.wait_for_function(f"before => {picture} !== before", arg=before)
    assert page.evaluate("scrollY") == at
