import dataclasses

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation import planner_runner
from fpg_bench.evaluation.planner_panel import load_planner_panel
from fpg_bench.evaluation.planner_runner import contender, play_pairing, play_planner
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.planning import Plan, as_planner
from fpg_bench.rows import RowFile

MATCHES, ROUNDS = 3, 4


@pytest.fixture(scope="module")
def panel():
    whole = load_planner_panel("planner-v1")
    scenario = dataclasses.replace(whole.scenario, steps_per_round=32, rounds_per_match=ROUNDS)
    return dataclasses.replace(whole, scenario=scenario, matches=MATCHES, allies=("idle", "expert"))


def play(panel, path, spec="circle", progress=lambda ally, rounds: None):
    file = RowFile(path)
    play_planner(contender(spec, panel), panel, file, progress)
    return file


def untimed(rows):
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


class Noting:
    """Flies to the box's corner, and notes what it is asked."""

    name, tier = "noting", "history"

    def __init__(self):
        self.asked = []

    def plan_batch(self, requests):
        self.asked += requests
        limits = requests[0].limits
        corner = np.zeros((limits.waypoints, 3))
        return [Plan(corner, "corner", "repaired", tokens=r.round, seconds=0.25) for r in requests]


def test_one_row_per_round_says_who_played_whom_and_how_the_path_came_about(panel, tmp_path):
    rows = play(panel, tmp_path / "rows.jsonl", Noting()).read()
    assert len(rows) == len(panel.allies) * MATCHES * ROUNDS
    assert {row["ally"] for row in rows} == set(panel.allies)
    assert {row["seed"] for row in rows} == set(evaluation_seeds(MATCHES))
    assert all(row["tokens"] == row["round"] for row in rows)
    assert all(row["steps"] == 32 for row in rows)
    same = {"planner": "noting", "tier": "history", "source": "corner", "status": "repaired", "seconds": 0.25}
    same |= {"panel": "planner-v1", "panel_hash": panel.hash[:16]}
    assert all(same.items() <= row.items() for row in rows)


def test_a_match_is_planned_round_by_round_from_its_own_history(panel):
    planner = Noting()
    list(play_pairing(planner, "idle", panel))
    assert [len(request.history) for request in planner.asked] == [
        k for k in range(ROUNDS) for _ in range(MATCHES)
    ]
    by_match = {request.seed: request for request in planner.asked}
    assert len(by_match) == MATCHES
    starts = {tuple(request.current_position) for request in planner.asked}
    assert len(starts) == MATCHES  # one start a match, the same in all its rounds


def test_a_match_does_not_depend_on_how_many_are_played(panel):
    few = list(play_pairing(as_planner("random", panel.scenario), "expert", panel))
    more = dataclasses.replace(panel, matches=MATCHES + 2)
    many = list(play_pairing(as_planner("random", panel.scenario), "expert", more))
    for some, all_of_them in zip(few, many, strict=True):
        assert untimed(some) == untimed(all_of_them[:MATCHES])


def test_resuming_plays_only_what_is_missing_and_gives_the_same_rows(panel, tmp_path, monkeypatch):
    whole = play(panel, tmp_path / "whole.jsonl")
    lines = whole.path.read_bytes().splitlines(keepends=True)
    cut = RowFile(tmp_path / "cut.jsonl")
    first = MATCHES * ROUNDS
    cut.path.write_bytes(b"".join(lines[: first + 5]) + lines[first + 5][:40])  # killed while writing
    played = []
    monkeypatch.setattr(planner_runner, "play_pairing", lambda *a: played.append(a[1]) or play_pairing(*a))
    play(panel, cut.path)
    assert played == ["expert"]
    assert untimed(cut.read()) == untimed(whole.read())
    play(panel, cut.path)
    assert played == ["expert"]


def test_rounds_are_kept_as_they_end(panel, tmp_path):
    class Stop(Exception):
        pass

    def stop(ally, rounds):
        if (ally, rounds) == ("expert", 2):
            raise Stop

    with pytest.raises(Stop):
        play(panel, tmp_path / "rows.jsonl", progress=stop)
    assert len(RowFile(tmp_path / "rows.jsonl").read()) == MATCHES * (ROUNDS + 2)


def test_rows_of_another_panel_are_refused(panel, tmp_path):
    file = play(panel, tmp_path / "rows.jsonl")
    with pytest.raises(UserError, match="another panel or scenario"):
        play(dataclasses.replace(panel, opponent="sweep"), file.path)


def test_code_that_has_changed_is_not_taken_for_what_was_played(panel, tmp_path, monkeypatch):
    source = tmp_path / "staying.py"
    source.write_text("from fpg_bench.planning.patterns import Hold\n\nclass Mine(Hold):\n    pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    file = play(panel, tmp_path / "rows.jsonl", "staying:Mine")
    assert {row["planner"] for row in file.read()} == {"staying:Mine"}
    play(panel, file.path, "staying:Mine")
    source.write_text(source.read_text() + "\n# changed\n")
    with pytest.raises(UserError, match="its file has changed"):
        play(panel, file.path, "staying:Mine")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tier": "oracle"}, "planner noting: its tier is 'oracle'; set it to one of none, history, ally"),
        ({"name": "circle"}, "calls itself circle, as one of the package does"),
    ],
)
def test_planners_that_cannot_be_told_apart_never_enter(panel, changes, message):
    planner = Noting()
    planner.__dict__ |= changes
    with pytest.raises(UserError, match=message):
        contender(planner, panel)


def test_unknown_planners_are_named(panel):
    with pytest.raises(UserError, match="did you mean 'circle'"):
        contender("circel", panel)


def test_a_planner_that_fails_is_told_with_ally_and_round(panel, tmp_path):
    class Tired(Noting):
        def plan_batch(self, requests):
            if len(requests[0].history) == 2:
                raise RuntimeError("no fuel")
            return super().plan_batch(requests)

    with pytest.raises(UserError, match=r"no fuel \(against idle, round 2\)"):
        play(panel, tmp_path / "rows.jsonl", Tired())
    assert len(RowFile(tmp_path / "rows.jsonl").read()) == MATCHES * 2
