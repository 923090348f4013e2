"""One grammar names every planner, and what is none is refused in one line."""

from __future__ import annotations

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER, STANDARD
from fpg_bench.players.planner import Plan, as_planner


class Mine:
    """A planner of one's own, made for a scenario."""

    name, tier = "mine", "none"

    def __init__(self, scenario=None):
        self.scenario = scenario

    def plan(self, history, current_position, limits, rng):
        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)


class Called(Mine):
    """One that is a function, too."""

    def __call__(self):
        raise AssertionError("it is a planner already")


class Nameless(Mine):
    name = None


class Numbered(Mine):
    name = 3


class Psychic(Mine):
    tier = "psychic"


class Tierless:
    name, plan = "tierless", Mine.plan


def made(scenario):
    return Mine(scenario)


def refusing():
    raise UserError("say please")


READY = Mine("ready")
NOT_A_PLANNER = object()


@pytest.mark.parametrize("maker", [Mine, made, f"{__name__}:made"])
def test_a_class_or_function_is_told_the_scenario(maker):
    assert as_planner(maker, PAPER).scenario == PAPER


@pytest.mark.parametrize("planner", [as_planner("hold", STANDARD), READY, Called()])
def test_an_object_with_plan_is_taken_as_it_is(planner):
    assert as_planner(planner, STANDARD) is planner


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("cirlce", "unknown planner 'cirlce'; did you mean 'circle'"),
        (3, "a name or an object with plan, got 3"),
        (f"{__name__}:NOT_A_PLANNER", "NOT_A_PLANNER': has no plan or plan_batch"),
        (refusing, "^say please$"),
        (dict, "planner dict: "),
        (Nameless, "planner Nameless: its name is None; set it to a word"),
        (Numbered(), "planner Numbered: its name is 3; set it to a word"),
        (f"{__name__}:Psychic", "planner mine: its tier is 'psychic'; set it to one of none, history, ally"),
        (Tierless(), "planner tierless: its tier is None; set it to one of none, history, ally"),
    ],
)
def test_what_is_no_planner_is_refused_in_one_line(spec, message):
    with pytest.raises(UserError, match=message):
        as_planner(spec, STANDARD)
