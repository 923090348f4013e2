"""Answers of a model: what is read, repaired and refused, that nothing is invented, and signs of no use."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits
from fpg_bench.products.language_models.answers import (
    EXAMPLE,
    READ_CHARS,
    REPEATED,
    STILL,
    UNFLYABLE,
    answer_schema,
    points_in,
    read_answer,
    uselessness,
)
from fpg_bench.products.language_models.prompts import load_prompt

from .fault_server import FaultServer, answer
from .playing import path, planner, play, request

LIMITS = Limits.of(STANDARD)
FOUR = Limits(STANDARD.box_m, 10.0, 300, 4)
TWO = Limits(STANDARD.box_m, 10.0, 300, 2)
PATH = [[10, 20, 30], [40.5, 50, 60], [70, 80, 0], [1500, 0, 600]]
NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def objects(path):
    return [dict(zip("xyz", point, strict=True)) for point in path]


def wide(text):
    """The text in full-width characters."""
    return "".join(chr(ord(c) + 0xFEE0) if "!" <= c <= "~" else c for c in text)


def narrow(text):
    """The text with its full-width characters as ASCII."""
    return "".join(chr(ord(c) - 0xFEE0) if 0xFF01 <= ord(c) <= 0xFF5E else c for c in text)


# Every form in which a path may be written, and the rung that reads it
FORMS = {
    "schema": (lambda p: json.dumps({"waypoints": objects(p)}), "json"),
    "schema with lists": (lambda p: json.dumps({"waypoints": p, "why": "it is near"}), "json"),
    "objects": (lambda p: json.dumps(objects(p), indent=2), "json"),
    "fenced": (lambda p: f"```json\n{json.dumps({'waypoints': p})}\n```", "json"),
    "thought": (lambda p: f"<think>[1, 2, 3] or so</think>{json.dumps(p)}", "json"),
    "directions": (lambda p: f"Next directions: {', '.join(map(str, p))}", "directions"),
    "directions after others": (
        lambda p: f"Next directions: [[1, 2, 3]]? No.\n**next directions:** {p}!",
        "directions",
    ),
    "directions as a key": (lambda p: json.dumps({"Next directions": p}), "directions"),
    "echoed history": (lambda p: f"Rewards: [1, 2, 3]: 4.5\nNext directions: {p}", "json"),
    "prose": (lambda p: f"I suggest {p[0]}, then {'; '.join(map(str, p[1:]))}. Good luck!", "triples"),
    "units": (lambda p: "\n".join("[{} m, {}m, {} metres]".format(*point) for point in p), "triples"),
    "NumPy": (lambda p: str(np.array(p)), "triples"),
    "full-width": (lambda p: wide(str([tuple(point) for point in p])), "triples"),
    "Chinese": (lambda p: "、".join("【{}米,{}米,{}米】".format(*point) for point in p), "triples"),
    "cut in the JSON": (lambda p: json.dumps({"waypoints": p, "why": "it"})[:-4], "triples"),
    "thought cut short": (lambda p: f"{[tuple(o) for o in p]} <THINK>or (1, 2, 3)?", "triples"),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_path_is_read_in_every_form(form):
    write, rung = FORMS[form]
    answer = read_answer(write(PATH), FOUR)
    assert answer.waypoints is not None, answer.problem
    assert answer.waypoints.tolist() == PATH
    assert (answer.rung, answer.repaired, answer.problem, answer.refused) == (rung, False, None, False)


def four(**changed):
    """Four points, some of them another: p0=[1, 2, 3]."""
    return [changed.get(f"p{i}", point) for i, point in enumerate(PATH)]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (str(PATH[:3]), "expected 4 points, got 3"),
        (str(four(p2=[0, -76, 0])), "point 3: y = -76 lies outside the box, 0 to 1500"),
        (str(four(p3=[0, 0, 631])), "point 4: z = 631 lies outside the box, 0 to 600"),
        (f"so {four(p0=['6E958', 1, 1])}".replace("'", ""), "point 1: x is not a finite number"),
        (json.dumps(four(p0=[float("nan"), 1, 1])), "point 1: x is not a finite number"),
        (str(four(p0=["9" * 5000, 1, 1])).replace("'", ""), "point 1: x is not a finite number"),
        (f"so (1, 1, 1), {four()}", "expected 4 points, got 5"),
        ('{"waypoints": "as above"}', "expected 4 points, got 0"),
        ('{"waypoints": [10, 20, 30, 40]}', "point 1: expected x, y and z, each a number"),
        (f'{{"waypoints": {PATH}}} or {{"waypoints": [[1, 2, 3]', "expected 4 points, got 1"),
        (json.dumps(four(p0=[True, 1, 1])), "point 1: expected x, y and z, each a number"),
        (json.dumps(four(p3={"x": 1, "y": 2})), "point 4: expected x, y and z, each a number"),
        ("", "no points found, expected 4"),
        (f"<think>{PATH}", "no points found, expected 4"),
        ("[1<think></think>2, 3, 4]" * 4, "no points found, expected 4"),
        (" ".join(f"{x}, {y}, {z}" for x, y, z in PATH), "no points found, expected 4"),
        ("[1-2-3] [1.2.3.4] [1,200, 300, 400] [0x1, 2, 3] [1, 2km, 3]", "no points found, expected 4"),
    ],
)
def test_a_broken_answer_names_the_rule(text, problem):
    answer = read_answer(text, FOUR)
    assert answer.waypoints is None
    assert answer.problem == problem
    assert not answer.repaired
    assert not answer.refused


@pytest.mark.parametrize(
    ("points", "read"),
    [
        ([*PATH, [99999, 1, 1]], PATH),
        (four(p1=[1575, 0, 0]), four(p1=[1500, 0, 0])),
        (four(p1=[-0.1, -75, 630]), four(p1=[0, 0, 600])),
    ],
)
def test_points_too_many_or_just_outside_the_box_are_repaired(points, read):
    answer = read_answer(str(points), FOUR)
    assert answer.waypoints.tolist() == read
    assert answer.repaired


ANSWER = json.dumps({"waypoints": PATH})
DRAFT = json.dumps({"waypoints": [[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]]})


def fence(text, language="json"):
    return f"```{language}\n{text}\n```"


# Answers as models write them, all of which hold other points than the path
USUAL = {
    "a point in prose before a fence": f"From [690, 790, 90] I fly\n{fence(ANSWER)}",
    "two fences": f"A draft:\n{fence(DRAFT)}\nBetter:\n{fence(ANSWER)}\nGood luck.",
    "fenced tuples": f"From [690, 790, 90]:\n{fence(', '.join(str(tuple(p)) for p in PATH), 'python')}",
    "an object of objects": f"At x=1, y=2, z=3. {json.dumps({'waypoints': objects(PATH)}, indent=1)}",
    "an object within an object": f"So: {json.dumps({'plan': {'waypoints': PATH}, 'from': [1, 2, 3]})}",
    "braces in strings": f"So: {json.dumps({'why': 'not } [1, 2, 3] {', 'waypoints': PATH})}",
    "a stray brace": f"Of the form {{{{x, y, z}} as in [1, 2, 3]: {ANSWER}",
    "an object cut short": f"From [690, 790, 90]: {ANSWER[:-1]}",
    "a comma too many": f"From [690, 790, 90]: {ANSWER[:-2]},]}}",
}
THOUGHTS = {
    "<think>": "</think>", "<thinking>": "</thinking>", "<Thought>": "</Thought>",
    "<thoughts>": "</thoughts>",
    "<reasoning>": "</reasoning>", "<reflection>": "</reflection>", "<scratchpad>": "</scratchpad>",
    "<seed:think>": "</seed:think>", "<longcat_think>": "</longcat_think>", "<|think|>": "<|end|>",
    "[THINK]": "[/THINK]", "[REASONING]": "[/REASONING]", "◁think▷": "◁/think▷",
    "<|START_THINKING|>": "<|END_THINKING|><|START_RESPONSE|>",
    "<|begin_of_thought|>": "<|end_of_thought|><|begin_of_solution|>",
    "<|inner_prefix|>": "<|inner_suffix|>", "<unused94>thought": "<unused95>",
    "<|channel>thought": "<channel|>",
    "<|channel|>analysis<|message|>": "<|end|><|start|>assistant<|channel|>final<|message|>",
    "analysis": "assistantfinal", "Here is my thought process:": "Here is my response:", "": "</think>",
}  # fmt: skip


@pytest.mark.parametrize("name", USUAL)
def test_the_path_of_a_usual_answer_is_what_stands_last(name):
    assert read_answer(USUAL[name], FOUR).waypoints.tolist() == PATH


@pytest.mark.parametrize("start", THOUGHTS)
@pytest.mark.parametrize("thought", [DRAFT, "[1, 2, 3] or so", fence(DRAFT)])
def test_points_in_reasoning_are_not_read(start, thought):
    for written in (ANSWER, fence(ANSWER), ", ".join(map(str, PATH)), f"{ANSWER}<|end|>"):
        text = f"{start}\n{thought}\n{THOUGHTS[start]}\n{written}"
        assert read_answer(text, FOUR).waypoints.tolist() == PATH


@pytest.mark.parametrize("start", [start for start in THOUGHTS if start.startswith(("<", "[", "◁"))])
def test_reasoning_that_is_cut_short_is_no_answer(start):
    assert read_answer(f"{start} {DRAFT}", FOUR).problem == "no points found, expected 4"


@pytest.mark.parametrize(
    "text",
    [
        "I'm sorry, but I can't help with that.",
        "I can’t assist with jamming.",
        "<think>They want a path.</think>I cannot plan attacks.",
        '{"error": "I am unable to do this"}',
        "抱歉,我无法回答这个问题。",
    ],
)
def test_a_refusal_is_told_from_garbage(text):
    answer = read_answer(text, FOUR)
    assert (answer.waypoints, answer.rung, answer.refused) == (None, "none", True)


def test_no_refusal_where_there_are_points_or_only_noise():
    assert read_answer(f"Sorry, I can't do better than {PATH}", FOUR).waypoints.tolist() == PATH
    assert not read_answer("I can't see why not [1, 2, 3]", FOUR).refused
    assert not read_answer("candid cantilevers", FOUR).refused


MEGABYTE = 2**20
BAD_TEXTS = {
    "brackets": "[" * 100_000,
    "nested objects": '{"a": ' * 100_000,
    "a closed nest": "[" * 99_999 + "1, 2, 3" + "]" * 99_999,
    "digits": "9" * READ_CHARS,
    "spaces and commas": "[1 , " * 40_000,
    "directions with stars": "next directions" + "*" * 190_000,
    "a fence": "```" + "a" * 190_000,
    "a megabyte of thoughts": "<think>" * (MEGABYTE // 7),
    "a megabyte": "[1, 2, 3], " * (MEGABYTE // 11),
    "fences": "```" * 60_000,
    "a channel of spaces": "<|channel|>" + " " * 180_000,
    "half a surrogate pair": "\ud800 [1, 2",
    "no characters": "\x00\x1b[2J",
}


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_bad_texts_are_read_in_a_moment(name):
    # A pattern that goes back over the text again and again would need minutes here
    for text in (BAD_TEXTS[name], "so " + BAD_TEXTS[name]):
        answer = read_answer(text, LIMITS)
        assert answer.waypoints is None
        assert answer.problem


def test_a_longer_answer_is_not_read_but_long_thoughts_are_left_out():
    answer = read_answer(f"{PATH}{' and so on' * (READ_CHARS // 10)}", FOUR)
    assert answer.problem.endswith(f"at most {READ_CHARS} are read")
    thoughts = "<think>" + "[1, 2, 3] " * READ_CHARS + "</think>"
    assert read_answer(f"{thoughts}{PATH}", FOUR).waypoints.tolist() == PATH


PIECES = """
    [ ] ( ) { } , : - . m x= y= z= "x": "y": "z": 1 20 7.5 -3 1620 1e2 6E958 NaN null true sorry ３ ， 【 】
    <think> </think> ```json ``` {"waypoints":
"""
pieces = st.sampled_from(["Next directions:", " ", "\n", "\ud800", "9" * 400, *PIECES.split()])
metres = st.integers(-40, 1560) | st.floats(-20, 630).map(lambda value: round(value, 3))
triples = st.tuples(metres, metres, metres).map(str)
garbled = st.lists(pieces | triples | st.text(max_size=5), max_size=40).map("".join)


@settings(max_examples=20)
@given(garbled | st.text() | st.lists(triples, min_size=2, max_size=5).map(" ".join))
def test_no_text_is_a_crash_and_no_waypoint_is_invented(text):
    answer = read_answer(text, TWO)
    assert (answer.waypoints is None) == (answer.problem is not None)
    if answer.waypoints is None:
        return
    assert answer.waypoints.shape == (2, 3)
    held = {float(number) for number in NUMBER.findall(narrow(text))}
    for value, side in zip(answer.waypoints.T, LIMITS.box_m, strict=True):
        unclipped = [v for v in value if not (answer.repaired and v in (0.0, side))]
        assert set(unclipped) <= held


def test_the_schema_asks_for_what_is_read():
    schema = answer_schema(LIMITS)
    waypoints = schema["properties"]["waypoints"]
    assert (waypoints["minItems"], waypoints["maxItems"]) == (16, 16)
    sides = waypoints["items"]["properties"]
    assert [sides[axis] for axis in "xyz"] == [
        {"type": "integer", "minimum": 0, "maximum": side} for side in (1500, 1500, 600)
    ]
    corner = {axis: side["maximum"] for axis, side in sides.items()}
    answer = read_answer(json.dumps({"waypoints": [corner] * 16}), LIMITS)
    assert (answer.rung, answer.repaired) == ("json", False)
    assert [part["additionalProperties"] for part in (schema, waypoints["items"])] == [False, False]


EXAMPLE_POINTS = points_in("Go by [873, 412, 288], then [519, 934, 141].")
FLOWN = np.linspace([690, 790, 90], [600, 700, 120], 16)
FAR = np.where(np.arange(16)[:, None] % 2, 0.0, [22.0, 0.0, 0.0])  # 2 s at 10 m/s reach 20 m


def with_points(*points):
    """A path that can be flown, but for these points in its middle."""
    waypoints = FLOWN.copy()
    waypoints[7 : 7 + len(points)] = points
    return waypoints


@pytest.mark.parametrize(
    ("waypoints", "why"),
    [
        (FLOWN, ""),
        (with_points(*EXAMPLE_POINTS), EXAMPLE),
        (with_points(EXAMPLE_POINTS[0]), ""),  # one may be chance
        (np.tile(FLOWN[0], (16, 1)), STILL),
        (FLOWN[:1] + np.arange(16)[:, None] % 2 * 9, STILL),
        (FAR, UNFLYABLE),
        (path(), REPEATED),  # as the history of the request shows it
        (path(2), ""),
        (np.vstack([path()[:12], path(30)[12:]]), REPEATED),
        (np.vstack([path()[:11], path(30)[11:]]), ""),
    ],
)
def test_each_sign_is_found(waypoints, why):
    asked = dataclasses.replace(request(round=2), current_position=FLOWN[0])
    if why == "" and waypoints is not FLOWN:
        asked = dataclasses.replace(asked, current_position=waypoints[0])
    assert uselessness(waypoints, asked, EXAMPLE_POINTS, []) == why


def test_a_path_of_a_round_before_is_repeated():
    asked = dataclasses.replace(request(round=0), current_position=path(5)[0])
    none = np.zeros((0, 3))
    assert uselessness(path(5), asked, none, []) == ""
    assert uselessness(path(5), asked, none, [path(9), path(5)]) == REPEATED


def test_the_planner_says_it_of_valid_plans_alone():
    texts = [json.dumps({"waypoints": points}) for points in (FLOWN.round().tolist(), FAR.tolist())]
    answers = iter([texts[0], texts[0], texts[1], "no", "no"])
    with FaultServer([answer(lambda body: next(answers))]) as server:
        plans, _ = play(planner(server))
    assert [plan.status for plan in plans] == ["ok", "ok", "ok", "fallback-invalid"]
    assert [plan.useless for plan in plans][1:] == [REPEATED, UNFLYABLE, None]


def test_the_example_of_a_profile_is_known_by_its_points():
    points = points_in(load_prompt("brief").example)
    assert len(points) >= 2
    assert len(points) < 16  # an echo of the prompt is no answer
