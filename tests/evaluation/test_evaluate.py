"""From players' names to a results folder, alone and many at once."""

import contextlib
import dataclasses
import json
import shutil
import sys
from types import SimpleNamespace

import pytest

import fpg_bench
from fpg_bench.errors import UserError
from fpg_bench.evaluation import evaluate as evaluating
from fpg_bench.evaluation.entry import Entry, entries_of, player_entry
from fpg_bench.evaluation.evaluate import evaluate, play_into, read_results
from fpg_bench.evaluation.field import load_field
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.table import write_table
from fpg_bench.jobs.run import Workers
from fpg_bench.players.scripted import Scripted
from fpg_bench.rows import RowFile
from tests.zoo.making import FIELD, make_agent, make_zoo


@pytest.fixture
def field(tmp_path, monkeypatch):
    """The name of a field of two counterparts, where the test runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yml").write_text(FIELD)
    return "small.yml"


@pytest.fixture
def agents(tmp_path):
    """Three training seeds of one entry."""
    zoo = make_zoo(tmp_path)
    return [str(make_agent(member, tmp_path / "agents" / member.name)) for member in zoo.members("small/ppo")]


def rows(folder):
    return sorted(map(json.dumps, RowFile(folder / "lines.jsonl").read()))


def test_a_line_per_training_seed_and_counterpart(field, agents, tmp_path):
    found = evaluate([*agents, "expert"], field, tmp_path / "out")
    assert {(s.entry, s.training_seeds) for s in found} == {("expert", 0), ("ppo", 3)}
    lines = RowFile(tmp_path / "out" / "lines.jsonl").read()
    assert len(lines) == 4 * 2
    assert {(line["entry"], line["training_seed"]) for line in lines} == {
        ("expert", None),
        *(("ppo", k) for k in range(3)),
    }
    again, played = read_results(tmp_path / "out")
    assert [s.lines for s in again] == [s.lines for s in found]
    assert played.hash == load_field(field).hash


def test_what_is_there_is_not_played_again(field, tmp_path, monkeypatch):
    evaluate(["expert", "idle"], field, tmp_path / "whole")
    evaluate(["expert"], field, tmp_path / "cut")
    file = tmp_path / "cut" / "lines.jsonl"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text(lines[0] + lines[1][:40])  # killed while the second line was written
    played = []
    monkeypatch.setattr(
        evaluating,
        "play",
        lambda entry, field, met, **more: (
            played.append((entry.name, met.name)) or play(entry, field, met, **more)
        ),
    )
    evaluate(["expert", "idle"], field, tmp_path / "cut")
    assert played == [
        ("expert", "sweep/circle"),
        ("idle", "adaptive/pursuit"),
        ("idle", "sweep/circle"),
    ]
    assert rows(tmp_path / "cut") == rows(tmp_path / "whole")
    played.clear()
    evaluate(["idle", "expert"], field, tmp_path / "cut")
    assert played == []


def test_finished_lines_survive_a_stop(field, tmp_path):
    class Stop(Exception):
        pass

    def stop(entry, counterpart, rounds):
        if (entry.name, counterpart.name) == ("idle", "sweep/circle"):
            raise Stop

    with pytest.raises(Stop):
        evaluate(["expert", "idle"], field, tmp_path / "out", progress=stop)
    assert len(rows(tmp_path / "out")) == 3


def test_results_of_another_field_number_or_version_are_refused(field, tmp_path):
    evaluate(["idle"], field, tmp_path / "out")
    with pytest.raises(
        UserError, match=r"lines of small.yml with 4 matches, .* with 3; choose another folder"
    ):
        evaluate(["idle"], field, tmp_path / "out", matches=3)
    about = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    (tmp_path / "small.yml").write_text(FIELD.replace("circle", "triangle"))
    with pytest.raises(UserError, match="or of another version of it"):
        evaluate(["idle"], field, tmp_path / "out")
    with pytest.raises(UserError, match=r"another version of small.yml; evaluate again"):
        read_results(tmp_path / "out")
    (tmp_path / "out" / "evaluation.json").write_text(json.dumps(about | {"field": "smal"}))
    with pytest.raises(UserError, match="unknown field 'smal'"):
        read_results(tmp_path / "out")


@pytest.mark.parametrize("about", [{"panel": "ally-v1", "panel_hash": "0", "rounds": 2}, {"field": 5}, {}])
def test_a_folder_of_the_old_protocol_is_named(field, tmp_path, about):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "evaluation.json").write_text(json.dumps(about))
    (tmp_path / "out" / "rows.jsonl").write_text('{"player": "expert"}\n')
    for use in (lambda: read_results(tmp_path / "out"), lambda: evaluate(["idle"], field, tmp_path / "out")):
        with pytest.raises(UserError, match=r"results .*out: .* is of an older protocol: evaluate again"):
            use()
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text()) == about


def test_an_evaluation_that_never_began_claims_no_folder(field, tmp_path):
    with contextlib.suppress(UserError):
        evaluate(["expertt"], field, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    about = {"field": "opponent-v1", "field_hash": "0", "matches": 2}
    (tmp_path / "out" / "evaluation.json").write_text(json.dumps(about))
    (tmp_path / "out" / "lines.jsonl").touch()
    assert evaluate(["idle"], field, tmp_path / "out")


@pytest.mark.parametrize("text", ["[1]\n", '{"x": 1}\n', "{\n"])
def test_what_is_no_line_is_one_clear_error(field, tmp_path, text):
    evaluate(["idle"], field, tmp_path / "out")
    with (tmp_path / "out" / "lines.jsonl").open("a") as file:
        file.write(text)
    with pytest.raises(UserError, match="line 3 is no"):
        evaluate(["idle"], field, tmp_path / "out")


def test_a_torn_last_line_is_dropped_and_played_again(field, tmp_path):
    before = evaluate(["idle"], field, tmp_path / "out")
    kept = rows(tmp_path / "out")
    with (tmp_path / "out" / "lines.jsonl").open("a") as file:
        file.write('{"field": "sm')
    assert read_results(tmp_path / "out")[0][0].lines == before[0].lines
    evaluate(["idle", "expert"], field, tmp_path / "out")
    assert set(kept) < set(rows(tmp_path / "out"))


def test_lines_of_another_field_in_the_file_are_refused(field, tmp_path):
    evaluate(["idle"], field, tmp_path / "out")
    file = tmp_path / "out" / "lines.jsonl"
    file.write_text(file.read_text().replace(load_field(field).hash[:16], "0" * 16))
    with pytest.raises(UserError, match=r"hold some of another field \(small\); choose another folder"):
        evaluate(["idle"], field, tmp_path / "out")


def test_another_policy_is_not_taken_for_the_one_that_was_played(field, agents, tmp_path):
    evaluate(agents, field, tmp_path / "out")
    shutil.rmtree(agents[0])
    zoo = make_zoo(tmp_path)
    make_agent(zoo.members()[0], tmp_path / "agents" / zoo.members()[0].name, seed=77)
    with pytest.raises(UserError, match=r"hold lines of another 'ppo' \(another policy, or its file"):
        evaluate(agents, field, tmp_path / "out")


def test_code_that_has_changed_is_not_taken_for_what_was_played(field, tmp_path, monkeypatch):
    source = tmp_path / "wobbly.py"
    source.write_text(
        "from fpg_bench.players.scripted import Scripted\n\ndef mine(s): return Scripted('ally', 'idle', s)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    (found,) = evaluate(["wobbly:mine"], field, tmp_path / "out")
    assert found.entry == "wobbly:mine"
    evaluate(["wobbly:mine"], field, tmp_path / "out")
    source.write_text(source.read_text() + "\n# changed\n")
    with pytest.raises(UserError, match="its file has changed"):
        evaluate(["wobbly:mine"], field, tmp_path / "out")


def test_agents_that_were_made_otherwise_are_not_merged_by_a_second_command(field, agents, tmp_path):
    evaluate(agents[:1], field, tmp_path / "out")
    zoo = make_zoo(tmp_path)
    other = str(make_agent(zoo.members()[1], tmp_path / "other", training_steps=5))
    with pytest.raises(UserError, match="hold 'ppo' with another budget, other hyper-parameters or other"):
        evaluate([other], field, tmp_path / "out")
    found = evaluate([other], field, tmp_path / "out", name="mine")
    assert {s.entry for s in found} == {"ppo", "mine"}
    found = evaluate(agents[1:], field, tmp_path / "out")  # more seeds of the first join it
    assert {(s.entry, s.training_seeds) for s in found} == {("ppo", 3), ("mine", 1)}


def test_the_same_training_seed_twice_is_found_before_anything_is_played(field, agents, tmp_path):
    zoo = make_zoo(tmp_path)
    twin = str(make_agent(zoo.members()[0], tmp_path / "twin", seed=5))
    with pytest.raises(UserError, match="two different players of training seed 0"):
        evaluate([*agents, twin], field, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_field_of_planners_names_the_other_command(tmp_path):
    with pytest.raises(UserError, match="measures planners; write fpg-bench plan compare --field planner-v1"):
        evaluate(["idle"], "planner-v1", tmp_path / "out")


@pytest.mark.parametrize("matches", [0, -1])
def test_matches_are_whole_numbers_above_0(field, tmp_path, matches):
    with pytest.raises(UserError, match="matches: expected a whole number above 0"):
        evaluate(["idle"], field, tmp_path / "out", matches=matches)


# From Python


def test_one_call_from_python_gives_a_table_and_keeps_nothing(field, tmp_path):
    mine = Scripted("ally", "idle", load_field(field).scenario)
    before = sorted(path.name for path in tmp_path.iterdir())
    found = fpg_bench.evaluate({"mine": mine, "random": "random"}, field)
    assert [s.entry for s in found] == ["mine", "random"]
    assert found.table().splitlines()[2].startswith("| mine | - | ")
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    by_name = fpg_bench.evaluate(["idle"], field)
    assert by_name[0].score == found[0].score
    with pytest.raises(UserError, match="mine: a folder keeps lines of players by their names"):
        fpg_bench.evaluate({"mine": mine}, field, tmp_path / "out")


def test_a_dataframe_has_a_row_per_entry_and_needs_pandas_alone(field, monkeypatch):
    """pandas is not asked for: a stand-in takes what its DataFrame would."""
    results = fpg_bench.evaluate(["random", "idle"], field)
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=list))
    found = results.dataframe()
    assert [row["entry"] for row in found] == ["idle", "random"]
    assert {"score", "score_low", "return_a_step sweep/circle", "hop_rate"} <= found[0].keys()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UserError, match="needs pandas"):
        results.dataframe()


# Many at once


@pytest.mark.slow
def test_the_lines_and_the_table_are_the_same_to_the_bit(field, agents, tmp_path):
    players = [*agents, "expert", "idle", "expert"]
    for out, jobs in (("many", 2), ("one", 1)):
        evaluate(players, field, tmp_path / out, jobs=jobs, say=lambda line: None)
        write_table(*read_results(tmp_path / out), tmp_path / out)
    assert rows(tmp_path / "many") == rows(tmp_path / "one")
    assert (tmp_path / "many" / "table.csv").read_text() == (tmp_path / "one" / "table.csv").read_text()


@pytest.mark.slow
def test_a_player_that_fails_does_not_hold_up_the_others(field, tmp_path, monkeypatch):
    source = "class Bad:\n    def predict(self, *a, **k):\n        raise RuntimeError('no idea')\n"
    (tmp_path / "bad.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UserError, match=r"bad:Bad - adaptive/pursuit: .*no idea \(and 1 more failed\)"):
        evaluate(["bad:Bad", "expert"], field, tmp_path / "out", jobs=2, say=lambda line: None)
    assert {json.loads(row)["entry"] for row in rows(tmp_path / "out")} == {"expert"}
    assert len(rows(tmp_path / "out")) == 2


@pytest.mark.slow
def test_an_agent_travels_to_the_worker(field, agents, tmp_path):
    entries = entries_of(agents[:1], load_field(field))
    expected = play_into(tmp_path / "one", field, load_field(field), entries)
    shutil.rmtree(agents[0])
    many = tmp_path / "many"
    found = play_into(many, field, load_field(field), entries, workers=Workers(2), say=lambda line: None)
    assert found[0].lines == expected[0].lines


def test_entries_of_one_name_and_seed_are_refused_however_they_come(field, tmp_path):
    one: Entry = player_entry("idle", name="x")
    with pytest.raises(UserError, match="x: two different players"):
        play_into(
            tmp_path / "out", field, load_field(field), [one, dataclasses.replace(one, fingerprint="2")]
        )
