import dataclasses
import itertools

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import PANEL_FOLDER, STANDARD_ERRORS, Reference, load_panel, panel_of
from fpg_bench.evaluation.planner_panel import load_planner_panel
from fpg_bench.evaluation.runner import play_entry

PANELS = sorted(path.stem for path in PANEL_FOLDER.glob("*.yml") if not path.stem.startswith("planner"))


@pytest.mark.parametrize("name", PANELS)
def test_shipped_panels_tell_random_from_reference(name):
    panel = load_panel(name)
    assert set(panel.references) == {entry.name for entry in panel.entries}
    for found in panel.references.values():
        assert len(found.random) == len(found.reference) >= panel.rounds
        assert found.standard_errors >= STANDARD_ERRORS
        assert found.scores(np.array(found.random)) == pytest.approx(0)
        assert found.scores(np.array(found.reference)).mean() == pytest.approx(100)


def test_scores_take_off_what_a_rounds_chance_is_worth():
    found = Reference(random=(0.0, 100.0, 200.0), reference=(10.0, 110.0, 210.0))
    assert found.scores(np.array([5.0, 105.0, 205.0])).tolist() == [50.0, 50.0, 50.0]
    assert found.scores(np.array([5.0])).tolist() == [50.0]
    with pytest.raises(UserError, match="4 rounds"):
        found.scores(np.zeros(4))


@pytest.mark.parametrize("name", PANELS)
def test_shipped_references_are_what_is_played(name):
    panel = load_panel(name)
    entry = panel.entries[-1]
    for spec, kept in (("random", "random"), (panel.reference, "reference")):
        rows = sorted(
            itertools.chain(*play_entry(spec, panel, entry, 3)), key=lambda r: (r["seed"], r["round"])
        )
        played = [row[f"{panel.side}_return"] for row in rows[:3]]
        assert played == pytest.approx(getattr(panel.references[entry.name], kept)[:3], abs=1e-3)


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("ally-v1", "c448953dd332"),
        ("opponent-v1", "d4b774e614c5"),
        ("opponent-learned-v1", "ff5f769fd0b1"),
        ("ally-planner-v1", "f480c4a81937"),
        ("ally-paper-v1", "2399fecd4df6"),
        ("opponent-paper-v1", "ba9fa7431ce2"),
    ],
)
def test_hashes_of_published_panels_stay(name, start):
    assert load_panel(name, references=False).hash.startswith(start)


def test_an_entry_with_a_planner_is_flown_as_the_planner_says():
    panel = load_panel("ally-planner-v1")
    names = [entry.name for entry in panel.entries]
    assert names[:2] == ["adaptive/interceptor", "adaptive/hill-climb"]
    assert panel.entry_scenario(panel.entries[0]).rounds_per_match == 10
    near = {}
    for entry in panel.entries:
        rounds = [rows[0] for rows in play_entry("expert", panel, entry, 10)]
        assert [row["round"] for row in rounds] == list(range(10))
        near[entry.planner] = sum(row["near"] for row in rounds)
    assert near["lead-pursuit"] > near["pursuit"] > 10 * near["hold"]


def test_the_planner_is_part_of_the_hash():
    panel = load_panel("ally-planner-v1", references=False)
    swapped = dataclasses.replace(panel.entries[0], planner="circle")
    assert dataclasses.replace(panel, entries=(swapped, *panel.entries[1:])).hash != panel.hash


def test_hash_speaks_of_what_is_played():
    panel = load_panel("ally-v1")
    harder = dataclasses.replace(panel.scenario, hop_cost=41)
    others = [
        dataclasses.replace(panel, rounds=99),
        dataclasses.replace(panel, season="1"),
        dataclasses.replace(panel, entries=panel.entries[1:]),
        dataclasses.replace(panel, scenario=harder),
    ]
    assert len({panel.hash, *(other.hash for other in others)}) == 5


CONTENT = """\
side: ally
scenario: standard
rounds: 10
reference: expert
entries:
  - {opponent: tone, path: pursuit}
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("side: ally", "side: referee", "side"),
        ("rounds: 10", "rounds: 0", "rounds"),
        ("rounds: 10", "round: 10", "unknown key 'round'; did you mean 'rounds'"),
        ("rounds: 10", "rounds: 10\nrounds_per_mach: 2", "did you mean 'rounds_per_match'"),
        ("rounds: 10\n", "", "lacks rounds$"),
        ("opponent: tone", "ally: tone", "expected entries with opponent and path"),
        ("path: pursuit", "path: pursuit, planner: circle", "path or planner"),
        ("path: pursuit", "planner: circel", "did you mean 'circle'"),
        ("rounds: 10", "rounds: 10\nrounds_per_match: none", "rounds_per_match: expected a whole number"),
        ("path: pursuit", "path: persuit", "did you mean 'pursuit'"),
        ("scenario: standard", "scenario: standrad", "did you mean 'standard'"),
        ("side: ally", "side: [ally", "not valid YAML"),
    ],
)
def test_bad_panel_files(tmp_path, old, new, message):
    path = tmp_path / "mine.yml"
    path.write_text(CONTENT)
    assert load_panel(str(path)).references is None
    path.write_text(CONTENT.replace(old, new))
    with pytest.raises(UserError, match=message):
        load_panel(str(path))


def test_unknown_panel_suggests():
    with pytest.raises(UserError, match="did you mean 'ally-v1'"):
        load_panel("aly-v1")


@pytest.mark.parametrize("load", [load_panel, load_planner_panel])
def test_a_file_that_is_not_there_cannot_be_read(load):
    with pytest.raises(UserError, match=r"^panel nope\.yml: cannot be read: No such file or directory$"):
        load("nope.yml")


def test_scores_of_another_panel_are_refused(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text(CONTENT)
    (tmp_path / "mine.scores.json").write_text('{"panel_hash": "0", "entries": {}}')
    with pytest.raises(UserError, match="measured for another panel"):
        load_panel(str(path))


@pytest.mark.parametrize(
    ("view_id", "options", "panel"),
    [
        ("FPG/AllyVsScripted-v0", {}, "ally-v1"),
        ("FPG/AllyVsPlanner-v0", {}, "ally-planner-v1"),
        ("FPG/OpponentVsScripted-v0", {}, "opponent-v1"),
        ("FPG/OpponentVsScripted-v0", {"path": "learned"}, "opponent-learned-v1"),
        ("FPG/OpponentVsPolicy-v0", {"path": None}, "opponent-v1"),
    ],
)
def test_every_view_has_its_panel(view_id, options, panel):
    assert panel_of(view_id, options) == panel
    assert load_panel(panel).side in view_id.lower()
