"""Marks: a planner that knows the path at once, or does without its rewards, is shown as such."""

import dataclasses
from pathlib import Path

import pytest

from fpg_bench.envs.duel import Duel
from fpg_bench.evaluation.columns import learning_curve
from fpg_bench.evaluation.entry import planner_entry
from fpg_bench.evaluation.field_file import load_field
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.leaderboard import planner_marks
from fpg_bench.leaderboard.board import make_board
from fpg_bench.leaderboard.cases import make_case
from fpg_bench.leaderboard.planner_marks import answers_alike, first_round, marked, shuffled_rewards
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.verify import verify
from fpg_bench.planning import BatchPlanner, Plan, as_planner
from fpg_bench.planning.interception import chase_waypoints

from .entering import enter

BOARD = Path(__file__).parents[2] / "leaderboard"
HISTORY_FREE = ["circle", "triangle", "rectangle", "hold", "random"]
LEARNING = ["hill-climb", "cma-es", "interceptor"]


class Posing(BatchPlanner):
    """Says that it knows its history alone, and works the ally's path out of the match's seed."""

    name, tier = "posing", "history"

    def __init__(self, scenario):
        self.scenario = scenario

    def plan_batch(self, requests):
        return [Plan(self.chase(request), self.name) for request in requests]

    def chase(self, request):
        duel = Duel(self.scenario, 1, as_planner("hold", self.scenario))
        duel.reset(seeds=request.seed)
        return chase_waypoints(duel.arena.ally_path(0), request.current_position, request.limits, True)


@pytest.fixture(scope="module")
def field():
    return dataclasses.replace(load_field("planner-v1"), matches=20)


def row_of(summary, tier="history", **told):
    planner = {"tier": tier, "curve": [dataclasses.asdict(of) for of in learning_curve(summary)], **told}
    return {"planner": planner, "measures": dict(summary.measures)}


def table_of(field, name="planner-v1"):
    scale = {"zero": field.scale.zero, "top": field.scale.top}
    return {"scale": scale, "fields": [{"role": "known", "name": name}]}


def test_a_planner_that_knows_the_path_is_flagged_by_its_first_round(field):
    entry = planner_entry(Posing(field.scenario), field)
    lines = [play(entry, field, counterpart) for counterpart in field.counterparts]
    row = row_of(summary_of(lines, field))
    found = first_round(row, table_of(field))
    assert found["flagged"] is True
    assert "without a history" in found["says"]
    assert first_round(row, table_of(field, "another"))["flagged"] is None
    row["planner"]["tier"] = "ally"
    assert first_round(row, table_of(field))["flagged"] is None


def test_it_is_flagged_by_its_answers_too(field):
    assert answers_alike(Posing(field.scenario), field)


@pytest.mark.parametrize("name", HISTORY_FREE + LEARNING)
def test_the_package_s_own_planners_are_not_flagged(name):
    case = make_case(BOARD, BOARD / "submissions/planner" / name)
    summary = case.known.summaries(case.fields)["known"]
    tier = case.known.fingerprint["planner"]["tier"]
    row = row_of(summary, tier)
    assert first_round(row, table_of(summary.field))["flagged"] is False
    assert shuffled_rewards(row, [row], name)["flagged"] is (False if name in LEARNING else None)


def recorded(control="none", model="m", value=1.0):
    told = {"tier": "history", "model": model, "server": "s", "prompt_hash": "p", "matches": 20}
    return {"planner": told | {"control": control, "curve": [value]}, "measures": {"return": value}}


@pytest.mark.parametrize(
    ("others", "flagged"),
    [
        ([], None),
        ([recorded("shuffled-rewards", model="n")], None),
        ([recorded("no-history")], None),
        ([recorded("shuffled-rewards", value=2.0)], False),
        ([recorded("shuffled-rewards")], True),
    ],
)
def test_a_recorded_model_is_compared_with_its_own_control(others, flagged):
    found = shuffled_rewards(recorded(), [recorded(), {"planner": None}, *others], None)
    assert found["flagged"] is flagged
    assert (flagged is None) == found["says"].startswith("not computed: a record cannot be asked again")


def test_one_match_is_said_to_be_too_few(field):
    row = recorded()
    row["planner"]["curve"] = [{"value": 90.0, "low": None, "high": None}]
    assert first_round(row, table_of(field))["says"] == "not computed: one match has no interval"


def test_the_page_shows_marks_and_hides_no_entry(board, in_process, monkeypatch, tmp_path):
    enter(board, "planner", "hold", script="hold")
    verify(board, say=lambda line: None)
    monkeypatch.setattr(planner_marks, "FIRST_ROUND", {"planner-v1": -1e6})
    shown = marked(make_board(board), board)
    (row,) = next(table["rows"] for table in shown["tracks"] if table["key"] == "planner")
    assert row["rank"] == [1, 1]
    assert row["planner"]["marks"]["first_round"]["flagged"]
    build_site(shown, tmp_path / "site", {})
    page = (tmp_path / "site/entries/planner/hold.html").read_text()
    assert "First round: scores " in page
    assert "Rewards shuffled" in page
    assert "First round: scores " in (tmp_path / "site/ranking.html").read_text()
