"""Prompt profiles: what they say, what they leave out, that they are repeatable, and what is refused."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits, Request
from fpg_bench.products.language_models.answers import read_answer
from fpg_bench.products.language_models.prompts import CONTROLS, PROMPTS, load_prompt, reask

LIMITS = Limits.of(STANDARD)
HERE = np.array([750.0, 12.4, 599.7])


def request(rounds=3, limits=LIMITS, seed=0, history=None):
    rng = np.random.default_rng(seed)
    if history is None:
        history = rng.uniform(-2, 20, (rounds, limits.waypoints, 4))
        history[..., :3] = rng.uniform(0, limits.box_m, (rounds, limits.waypoints, 3))
    return Request(history, HERE, limits, rng, round=len(history))


def history_of(means):
    """A history of rounds with these mean rewards, flown at z = the round's number."""
    history = np.zeros((len(means), 16, 4))
    history[..., 3] = np.array(means)[:, None]
    history[..., 2] = np.arange(1, len(means) + 1)[:, None]
    return history


def text(name, asked, control="none"):
    return "\n".join(message["content"] for message in load_prompt(name).messages(asked, control))


def test_the_paper_s_three_strings_stand_in_their_form():
    history = np.array([[[1.4, 2.6, 3, -0.001]] * 3, [[750, 750, 300, 12.346]] * 3])
    limits = Limits(STANDARD.box_m, 10.0, 300, 3)
    lines = text("paper", request(history=history, limits=limits)).split("\n")
    assert lines[1:] == [
        *["Positions and Rewards: [1, 3, 3]: 0.00"] * 3,
        *["Positions and Rewards: [750, 750, 300]: 12.35"] * 3,
        "Current Position: [750, 12, 600]",
        "Next directions: [[x1, y1, z1], [x2, y2, z2], ..., [x3, y3, z3]]",
    ]


@pytest.mark.parametrize(
    "fact",
    [
        "x from 0 to 1500, y from 0 to 1500, z from 0 to 600",
        "exactly 16 waypoints",
        "at most 187 m from each waypoint to the next",
        "after 18.75 s",
        "simulated game",
        "same place and flies the same smooth curve",
        "x 750, y 12, z 600",
        '{"waypoints": [{"x": x1',
        "Round 2, mean reward 5.00\n10,0,0,2,5.00\n29,0,0,2,5.00\n",
    ],
)
def test_the_standard_profile_says_what_the_rules_allow_to_know(fact):
    assert fact in text("standard", request(history=history_of([1, 5, 2])))


def test_numbers_follow_the_limits():
    limits = Limits((1000.5, 800.0, 300.0), 7.0, 100, 8)
    content = text("standard", request(limits=limits))
    assert "x from 0 to 1000, y from 0 to 800, z from 0 to 300" in content
    assert "exactly 8 waypoints" in content
    assert "at most 87 m" in content
    assert '{"x": x8, "y": y8, "z": z8}]}' in content


@pytest.mark.parametrize("name", PROMPTS)
def test_a_prompt_is_short_ends_with_the_answer_s_form_and_is_none_itself(name):
    for rounds in (0, 1, 9):
        content = text(name, request(rounds))
        assert re.search(r"(directions: \[\[|\"waypoints\": \[).*[\]}]$", content)
        assert read_answer(content, LIMITS).waypoints is None
    history = np.tile([1499.0, 1499.0, 599.0, -19.99], (200, 16, 1))
    # More tokens than any tokeniser makes of it: digits and marks one by one
    assert len(re.findall(r"\d|[^\W\d]{1,5}|[^\w\s]|\n", text(name, request(history=history)))) < 6000


@pytest.mark.parametrize(
    ("means", "shown"),
    [
        ([5, 4, 3], [1, 2, 3]),
        ([1, 2, 3, 4, 5, 6, 7, 8], [1, 5, 6, 7, 8]),
        ([1, 9, 2, 8, 3, 7, 4, 1, 1, 1], [1, 2, 4, 6, 7, 8, 9, 10]),
        # The first of equals, even where their last bits differ
        ([0, 5, 5 + 1e-9, 5 - 1e-9, 5, 5, 1, 1, 1, 1], [1, 2, 3, 4, 7, 8, 9, 10]),
    ],
)
def test_the_first_the_best_and_the_latest_rounds_are_shown(means, shown):
    content = text("standard", request(history=history_of(means)))
    assert [int(number) for number in re.findall(r"Round (\d+), mean", content)] == shown
    rows = re.findall(r"^\d+,0,0,(\d+),", content, re.MULTILINE)
    assert [int(z) for z in rows] == [k for k in shown for _ in range(16)]


def test_each_line_says_when_in_the_round_the_opponent_was_there():
    duel = make_duel(planner="random")
    duel.reset(seeds=3)
    rest, track = np.zeros((1, 9), np.float32), []
    for _ in range(300):
        duel.step(rest, rest)
        track.append(duel.batch.games["opponent_position"][0].copy())
    content = text("standard", request(history=duel.batch.segments))
    rows = re.findall(r"^(\d+),(\d+),(\d+),(\d+),", content, re.MULTILINE)
    assert len(rows) == 16
    for second, *place in rows:
        assert [float(value) for value in place] == pytest.approx(track[int(second) - 1], abs=0.51)


@pytest.mark.parametrize("name", PROMPTS)
@pytest.mark.parametrize("control", CONTROLS)
def test_the_same_request_gets_the_same_words_and_is_left_as_it_is(name, control):
    asked = request(history=history_of([1.0, 2.0]) + np.array([187.5, 187.5, 187.5, 0]))
    history, state = asked.history.copy(), asked.rng.bit_generator.state
    nudged = request(history=history + np.array([1e-9, -1e-9, 1e-9, 0]))  # in its last bits
    assert text(name, asked, control) == text(name, asked, control) == text(name, nudged, control)
    assert np.array_equal(asked.history, history)
    assert asked.rng.bit_generator.state == state


def test_shuffled_rewards_keep_the_positions_and_the_rewards_but_not_their_pairs():
    def rows(control, seed=0):
        asked = dataclasses.replace(request(3), rng=np.random.default_rng(seed))
        rows = re.findall(r"(\[\d+, \d+, \d+\]): (-?[\d.]+)", text("paper", asked, control))
        return [place for place, _ in rows], [reward for _, reward in rows]

    (places, rewards), (shuffled_places, shuffled) = rows("none"), rows("shuffled-rewards")
    assert len(places) == 48
    assert places == shuffled_places
    assert sorted(rewards) == sorted(shuffled)
    moved = [a != b for a, b in zip(rewards, shuffled, strict=True)]
    assert sum(moved) > 40
    assert set(rewards[:16]) != set(shuffled[:16])  # across rounds, too
    assert rows("shuffled-rewards", 1)[1] != shuffled


@pytest.mark.parametrize("name", PROMPTS)
def test_no_history_reads_like_a_first_round(name):
    first = text(name, request(0))
    assert text(name, request(5), "no-history") == first
    assert "Round 1" not in first
    assert "$" not in first
    assert "\n\n\n" not in first


def test_a_re_ask_repeats_the_reply_and_names_the_rule():
    asked = load_prompt("standard").messages(request())
    talk = reask(asked, "[[1, 2, 3]]", "expected 16 points, got 1")
    assert talk[:-2] == asked
    assert [message["role"] for message in talk[-2:]] == ["assistant", "user"]
    assert talk[-2]["content"] == "[[1, 2, 3]]"
    assert "expected 16 points, got 1" in talk[-1]["content"]


@pytest.mark.parametrize("reply", ["", " \n", "x" * 10**6, "half a pair \ud800"])
def test_any_reply_can_be_sent_again(reply):
    content = reask([], reply, "no points found")[0]["content"]
    assert 0 < len(content.encode()) <= 4000


OWN = """
about: mine
rounds: {first: 1, best: 0, latest: 1}
system: You fly in a box of $box_x m.
heading: "-- $round"
row: "$second s: $reward"
user: |
  Costs $$5. $history
  Go from $x.
"""


@pytest.fixture
def own(tmp_path):
    """Loads a profile of one's own from its text."""

    def load(content):
        path = tmp_path / "own.yml"
        path.write_text(content, encoding="utf-8")
        return load_prompt(str(path))

    return load


def test_a_profile_of_one_s_own(own):
    prompt = own(OWN)
    system, user = prompt.messages(request(history=history_of([1, 2, 3])))
    assert prompt.name == "own"
    assert system == {"role": "system", "content": "You fly in a box of 1500 m."}
    assert user["role"] == "user"
    assert user["content"].startswith("Costs $5. -- 1\n10 s: 1.00\n29 s: 1.00\n")
    assert "-- 3\n10 s: 3.00" in user["content"]
    assert "-- 2" not in user["content"]
    assert user["content"].endswith("Go from 750.")


def test_the_hash_follows_what_is_asked_alone(own):
    own_hash = own(OWN).hash
    assert own_hash == own(OWN.replace("about: mine", "about: still mine")).hash
    for old, new in (("Go from", "Start at"), ("best: 0", "best: 1"), ("-- ", "== ")):
        assert own_hash != own(OWN.replace(old, new)).hash
    assert len({load_prompt(name).hash for name in PROMPTS} | {own_hash}) == len(PROMPTS) + 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("about: mine", "", "own.yml: lacks about"),
        ("heading:", "headings:", "unknown key 'headings'; did you mean 'heading'"),
        ("Go from $x", "Go from $position", r"user: unknown placeholder \$position; known: box_x"),
        ("$reward", "$rewards", r"row: unknown placeholder \$rewards; did you mean 'reward'"),
        ("Costs $$5", "Costs $5", r"user: a \$ without a name behind it; write \$\$"),
        ("{first: 1, best: 0, latest: 1}", "3", "rounds: expected a mapping, got 3"),
        ("best: 0", "best: -1", "rounds.best: expected a whole number, 0 or more, got -1"),
        (OWN, "about: !!python/object/apply:os.system [id]", "not valid YAML"),
    ],
)
def test_a_broken_profile_is_refused_in_one_line(own, old, new, message):
    with pytest.raises(UserError, match=message):
        own(OWN.replace(old, new, 1))
