import dataclasses

import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.planner_panel import load_planner_panel
from fpg_bench.players.scripted import SCRIPTED

CONTENT = """\
side: planner
scenario: standard
rounds_per_match: 4
matches: 5
opponent: adaptive
allies: [idle, expert]
last_rounds: 2
zero: random
bound: hold
"""


def test_the_shipped_panel_plays_matches_on_planned_paths_against_scripted_allies_at_full_speed():
    panel = load_planner_panel("planner-v1")
    assert panel.scenario.opponent_path == "waypoints"
    assert (panel.rounds, panel.matches, panel.last_rounds) == (10, 100, 3)
    assert set(panel.allies) == set(SCRIPTED["ally"]) - {"random"}


def test_a_panel_of_ones_own(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text(CONTENT)
    panel = load_planner_panel(str(path))
    assert (panel.name, panel.rounds, panel.matches) == ("mine", 4, 5)
    assert panel.allies == ("idle", "expert")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("matches: 5", "matches: 0", "matches: expected a whole number above 0, got 0"),
        ("matches: 5", "matches: true", "matches: expected a whole number"),
        ("matches: 5", "match: 5", "unknown key 'match'; did you mean 'matches'"),
        ("rounds_per_match: 4", "rounds_per_match: four", "rounds_per_match: expected a whole number"),
        ("rounds_per_match: 4", "rounds_per_match: 100000", "rounds_per_match"),
        ("last_rounds: 2", "last_rounds: 5", "last_rounds: at most the match's 4 rounds"),
        ("[idle, expert]", "[]", "allies: expected a list of different names"),
        ("[idle, expert]", "[idle, idle]", "allies: expected a list of different names"),
        ("[idle, expert]", "idle", "allies: expected a list of different names"),
        ("bound: hold", "bound: random", "zero and bound are both 'random'"),
        ("scenario: standard", "scenario: standrad", "did you mean 'standard'"),
        ("side: planner", "side: ally", "does not compare planners"),
        ("side: planner", "side: [planner", "not valid YAML"),
    ],
)
def test_bad_panel_files(tmp_path, old, new, message):
    path = tmp_path / "mine.yml"
    path.write_text(CONTENT.replace(old, new))
    with pytest.raises(UserError, match=message):
        load_planner_panel(str(path))


def test_each_kind_of_panel_names_the_command_that_plays_it():
    with pytest.raises(UserError, match=r"^panel planner-v1: .* fpg-bench plan compare --panel planner-v1$"):
        load_panel("planner-v1")
    with pytest.raises(UserError, match=r"^panel ally-v1: .* fpg-bench evaluate --panel ally-v1$"):
        load_planner_panel("ally-v1")
    with pytest.raises(UserError, match="did you mean 'planner-v1'"):
        load_planner_panel("planer-v1")


def test_hash_speaks_of_everything_that_decides():
    panel = load_planner_panel("planner-v1")
    changes = {
        "scenario": dataclasses.replace(panel.scenario, rounds_per_match=9),
        "matches": 99,
        "opponent": "sweep",
        "allies": panel.allies[1:],
        "last_rounds": 2,
        "zero": "hold",
        "bound": "pursuit",
        "season": "1",
    }
    others = [dataclasses.replace(panel, **{name: value}) for name, value in changes.items()]
    assert len({panel.hash, *(other.hash for other in others)}) == len(changes) + 1
    assert dataclasses.replace(panel, name="same").hash == panel.hash
