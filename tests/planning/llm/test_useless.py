"""Valid paths of no use: each sign is found, and a path of use has none."""

import dataclasses
import json

import numpy as np
import pytest

from fpg_bench.planning.llm.answers import points_in
from fpg_bench.planning.llm.prompts import load_prompt
from fpg_bench.planning.llm.useless import EXAMPLE, REPEATED, STILL, UNFLYABLE, why_useless

from .fault_server import FaultServer, answer
from .playing import path, planner, play, request

EXAMPLE_POINTS = points_in("Go by [873, 412, 288], then [519, 934, 141].")
FLOWN = np.linspace([690, 790, 90], [600, 700, 120], 16)
FAR = np.where(np.arange(16)[:, None] % 2, [0.0, 0.0, 0.0], [1500.0, 1500.0, 600.0])


def with_points(*points):
    """A path that can be flown, but for these points in its middle."""
    found = FLOWN.copy()
    found[7 : 7 + len(points)] = points
    return found


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
    assert why_useless(waypoints, asked, EXAMPLE_POINTS, []) == why


def test_a_path_of_a_round_before_is_repeated():
    asked = dataclasses.replace(request(round=0), current_position=path(5)[0])
    none = np.zeros((0, 3))
    assert why_useless(path(5), asked, none, []) == ""
    assert why_useless(path(5), asked, none, [path(9), path(5)]) == REPEATED


def test_the_planner_says_it_of_valid_plans_alone():
    said = [json.dumps({"waypoints": points}) for points in (FLOWN.round().tolist(), FAR.tolist())]
    texts = iter([said[0], said[0], said[1], "no", "no"])
    with FaultServer([answer(lambda body: next(texts))]) as server:
        plans, _ = play(planner(server))
    assert [plan.status for plan in plans] == ["ok", "ok", "ok", "fallback-invalid"]
    assert [plan.useless for plan in plans][1:] == [REPEATED, UNFLYABLE, None]


def test_the_example_of_a_profile_is_known_by_its_points():
    points = points_in(load_prompt("brief").example)
    assert len(points) >= 2
    assert len(points) < 16  # an echo of the prompt is no answer
