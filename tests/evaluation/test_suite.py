import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.play import match_of, rounds
from fpg_bench.evaluation.suite import Scale, load_suite, suite_names, suite_of
from fpg_bench.game.scenario import STANDARD, as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import suites_folder

PUBLIC = [name for name in suite_names() if name.endswith("-v1")]
CONTENT = """\
side: ally
scenario: standard
matches: 10
rivals:
  - {opponent: tone, path: pursuit}
"""
PLANNED = """\
side: planner
scenario: standard
rounds_per_match: 4
matches: 5
opponent: adaptive
last_rounds: 2
rivals: [{ally: idle}, {ally: expert}]
"""


# A suite that changes is another suite, with a name of its own; a new one is added there.
HASHES = json.loads(Path(__file__).with_name("suites.json").read_text())


def written(tmp_path, content):
    path = tmp_path / "mine.yml"
    path.write_text(content)
    return str(path)


@pytest.mark.parametrize("name", PUBLIC)
def test_public_suites_have_a_scale_and_rivals_that_can_be_had(name):
    suite = load_suite(name)
    assert suite.scale != Scale()
    assert suite.scale.score(suite.scale.random_play) == 0
    assert suite.scale.score(suite.scale.top) == pytest.approx(100)
    whole = dataclasses.replace(suite.scale, random=None)
    assert whole.score(suite.scale.lost) == pytest.approx(-100)


def test_every_id_has_its_suite():
    for env_id, options, name in (
        ("FPG/AllyVsScripted-v0", {}, "ally-v2"),
        ("FPG/AllyVsPlanner-v0", {}, "ally-planner-v1"),
        ("FPG/OpponentVsScripted-v0", {"path": "learned"}, "opponent-learned-v2"),
        ("FPG/OpponentVsPolicy-v0", {"path": None}, "opponent-v2"),
        ("FPG/AllyVsScripted-v0", {"scenario": "link"}, "ally-link-v1"),
        ("FPG/OpponentVsPolicy-v0", {"scenario": "paper", "path": "circle"}, "opponent-paper-v1"),
    ):
        assert suite_of(GameSpec(env_id, **options)) == name
        assert load_suite(name).side in env_id.lower()


def test_ranges_have_the_suite_of_their_preset_however_they_are_written(tmp_path):
    ranges = {"preset": "link", "hop_airtime_s": [0.1, 0.5]}
    (tmp_path / "drawn.yml").write_text(yaml.safe_dump(ranges))
    for scenario in (ranges, [ranges], str(tmp_path / "drawn.yml"), as_scenario(ranges)):
        assert suite_of(GameSpec("FPG/AllyVsScripted-v0", scenario=scenario)) == "ally-link-v1"


def test_a_suite_of_ones_own(tmp_path):
    suite = load_suite(written(tmp_path, PLANNED))
    assert (suite.name, suite.rounds_per_match, suite.matches, suite.rounds) == ("mine", 4, 5, 20)
    assert [c.players for c in suite.rivals] == [("idle",), ("expert",)]
    assert (suite.other_side, suite.return_name) == ("ally", "opponent_return")
    assert suite.named("idle") is suite.rivals[0]
    with pytest.raises(UserError, match="no rival 'idel'; did you mean 'idle'"):
        suite.named("idel")


def test_rivals_have_names_changes_and_several_players(tmp_path):
    changed = "{opponent: [tone, comb], path: circle, name: both, changes: {hop_cost: 10}}"
    suite = load_suite(written(tmp_path, CONTENT + f"  - {changed}\n"))
    one, both = suite.rivals
    assert (one.name, both.name, both.players) == ("tone/pursuit", "both", ("tone", "comb"))
    assert (both.scenario.hop_cost, both.scenario.opponent_path) == (10, "circle")
    assert one.scenario.hop_cost == STANDARD.hop_cost
    table = match_of("idle", suite, both, matches=8)
    list(rounds(table, dataclasses.replace(suite, matches=8)))
    tallies = table.duel.batch.tallies
    assert ((tallies["tone"] > 0) != (tallies["comb"] > 0)).all()  # one of them plays a round
    assert (tallies["tone"] > 0).any()
    assert (tallies["comb"] > 0).any()


def test_rewards_per_step_are_those_of_the_rounds_that_count(tmp_path):
    suite = load_suite(written(tmp_path, PLANNED))
    returns = np.array([0, 0, 300, 600, 0, 0, 0, 0])  # of two matches of four rounds, 300 steps each
    assert suite.rewards(returns).tolist() == [1.5, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("opponent: tone", "ally: tone", r"rivals\[0\]: expected opponent, a player's name"),
        ("path: pursuit", "path: pursuit, planner: circle", "path or planner"),
        ("path: pursuit", "planner: circel", "did you mean 'circle'"),
        ("path: pursuit", "path: persuit", "did you mean 'pursuit'"),
        ("path: pursuit", "changes: {steps_per_round: 10}", "is the same for all rivals"),
        ("pursuit}", "pursuit}\n  - {opponent: tone, path: pursuit}", "'tone/pursuit' is listed twice"),
    ],
)
def test_bad_suite_files(tmp_path, old, new, message):
    assert old in CONTENT
    with pytest.raises(UserError, match=message):
        load_suite(written(tmp_path, CONTENT.replace(old, new)))


def test_an_unknown_suite_suggests_and_a_missing_file_is_said():
    with pytest.raises(UserError, match="did you mean 'ally-v2'"):
        load_suite("aly-v1")
    with pytest.raises(UserError, match=r"^suite nope\.yml: cannot be read: No such file or directory$"):
        load_suite("nope.yml")


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("ally-v1", "; use 'ally-v2'"),
        ("opponent-learned-shifted-v1", "; use 'opponent-learned-shifted-v2'"),
        ("ally-season-1", "; use 'ally-season-5'"),
        ("planner-season-2", "; use 'planner-season-5'"),
        ("ally-v2@season-4", ": a suite has evaluation seeds of its own; use 'ally-v2'"),
        ("ally-v1@season-1", ": a suite has evaluation seeds of its own; use 'ally-v2'"),
        ("aly-v2@season-4", "; did you mean 'ally-v2'?"),
    ],
)
def test_a_suite_that_went_names_the_one_that_stays(name, remedy):
    with pytest.raises(UserError) as error:
        load_suite(name)
    assert str(error.value) == f"unknown suite {name!r}{remedy}"


def test_the_hash_speaks_of_everything_that_decides():
    suite = load_suite("planner-v1")
    first, *others = suite.rivals
    harder = dataclasses.replace(first.scenario, hop_cost=41)
    changes = [
        {"side": "opponent"},
        {"matches": 99},
        {"season": "1"},
        {"opponent": "sweep"},
        {"last_rounds": 2},
        {"scale": Scale(0.0, 30.0)},
        {"rivals": tuple(others)},
        {"rivals": (dataclasses.replace(first, players=("random",)), *others)},
        {"rivals": (dataclasses.replace(first, planner="circle"), *others)},
        {"rivals": (dataclasses.replace(first, scenario=harder), *others)},
    ]
    hashes = {suite.hash, *(dataclasses.replace(suite, **change).hash for change in changes)}
    assert len(hashes) == len(changes) + 1
    assert dataclasses.replace(suite, name="same").hash == suite.hash
    measured = dataclasses.replace(suite.scale, random=5.0)
    assert dataclasses.replace(suite, scale=measured).hash == suite.hash
    assert measured.lost == suite.scale.lost


def test_committed_suites_stay_what_they_are():
    """Results name them by their hash."""
    known = {file.stem: load_suite(file.stem).hash for file in suites_folder().glob("*.yml")}
    assert known == HASHES
