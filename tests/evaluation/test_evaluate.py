import dataclasses
import json

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation import runner, table
from fpg_bench.evaluation.evaluate import evaluate, read_results
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.runner import Contestant, contestant, play_entry, play_panel
from fpg_bench.evaluation.summary import summarise
from fpg_bench.rows import RowFile


@pytest.fixture(scope="module")
def panel():
    whole = load_panel("ally-v1")
    return dataclasses.replace(whole, rounds=6, entries=whole.entries[5:8])


def play(panel, path, spec="expert", **options):
    file = RowFile(path)
    play_panel(Contestant(spec, spec), panel, file, **options)
    return file


def test_one_row_per_round_and_entry_with_the_same_chance(panel, tmp_path):
    rows = play(panel, tmp_path / "rows.jsonl").read()
    assert len(rows) == 18
    seeds = {
        entry.name: [row["seed"] for row in rows if row["entry"] == entry.name] for entry in panel.entries
    }
    assert all(found == seeds[panel.entries[0].name] for found in seeds.values())
    assert all(row["steps"] == 300 == sum(row["ally_points"]) == sum(row["jam_points"]) for row in rows)


def test_resuming_plays_only_what_is_missing_and_gives_the_same_rows(panel, tmp_path, monkeypatch):
    whole = play(panel, tmp_path / "whole.jsonl")
    cut = RowFile(tmp_path / "cut.jsonl")
    lines = whole.path.read_bytes().splitlines(keepends=True)
    cut.path.write_bytes(b"".join(lines[:8]) + lines[8][:40])  # killed while writing the second entry
    played = []
    monkeypatch.setattr(runner, "play_entry", lambda *a: played.append(a[2].name) or play_entry(*a))
    play(panel, cut.path)
    assert played == [entry.name for entry in panel.entries[1:]]
    assert sorted(cut.path.read_bytes().splitlines()) == sorted(whole.path.read_bytes().splitlines())
    played.clear()
    play(panel, cut.path)
    assert played == []


def test_rows_of_another_scenario_or_player_are_refused(panel, tmp_path):
    file = play(panel, tmp_path / "rows.jsonl")
    other = dataclasses.replace(panel, scenario=dataclasses.replace(panel.scenario, hop_cost=41))
    with pytest.raises(UserError, match="another panel or scenario"):
        play(other, file.path)
    with pytest.raises(UserError, match="another policy"):
        play_panel(Contestant("expert", "idle"), panel, file)


def test_finished_rows_survive_a_stop(panel, tmp_path):
    class Stop(Exception):
        pass

    def stop_at_the_third(entry):
        if entry == panel.entries[2]:
            raise Stop

    with pytest.raises(Stop):
        play(panel, tmp_path / "rows.jsonl", progress=stop_at_the_third)
    assert len(RowFile(tmp_path / "rows.jsonl").read()) == 12


def test_batch_size_does_not_matter(panel):
    entry = panel.entries[0]
    few = next(play_entry("random", panel, entry, 3))
    many = next(play_entry("random", panel, entry, 6))
    assert few == many[:3]


def test_summary_normalises_and_pools(panel, tmp_path):
    rows = play(panel, tmp_path / "rows.jsonl").read()
    rows += play(panel, tmp_path / "idle.jsonl", "idle").read()
    best, other = summarise(rows, panel)
    assert best.score.value > other.score.value
    expert = best if best.player == "expert" else other
    mine = [row for row in rows if row["player"] == "expert"]
    name = panel.entries[0].name
    returns = np.array([row["ally_return"] for row in mine if row["entry"] == name])
    assert expert.entries[name] == pytest.approx(panel.references[name].scores(returns).mean())
    assert expert.mean == pytest.approx(np.mean(list(expert.entries.values())))
    assert expert.measures["overlap_ratio"] == sum(r["overlap"] for r in mine) / sum(r["steps"] for r in mine)
    assert expert.measures["ally_return"] == pytest.approx(np.mean([r["ally_return"] for r in mine]))
    assert expert.score.low < expert.score.value < expert.score.high


def test_incomplete_contestants_are_left_out(panel, tmp_path):
    rows = play(panel, tmp_path / "rows.jsonl").read()
    assert summarise(rows[:-1], panel) == []


def test_training_seeds_are_one_line(panel, tmp_path):
    rows = play(panel, tmp_path / "rows.jsonl").read()
    trained = [row | {"player": "agent", "training_seed": k} for k in range(3) for row in rows]
    (found,) = summarise(trained, panel)
    assert (found.player, found.training_seeds, found.score.over) == ("agent", 3, "training seeds")
    assert found.score.high == pytest.approx(found.score.low)  # three equal seeds


def test_oracles_and_wrong_sides_never_enter(panel):
    with pytest.raises(UserError, match="sees the full state"):
        contestant("oracle", "ally", panel)
    with pytest.raises(UserError, match="unknown ally 'adaptive'"):
        contestant("adaptive", "ally", panel)


def test_evaluate_and_tables(tmp_path):
    found = evaluate(["expert", "idle"], "opponent-v1".replace("opponent", "ally"), tmp_path, rounds=2)
    assert [s.player for s in found] == ["expert", "idle"]
    again, panel = read_results(tmp_path)
    assert again == found
    table.write_table(found, panel, tmp_path)
    text = (tmp_path / "table.md").read_text()
    assert text.splitlines()[2].startswith("| expert | - |")
    assert "0 = random, 100 = expert" in text
    assert (tmp_path / "table.csv").read_text().splitlines()[1].startswith("expert,0,20,")
    assert (tmp_path / "table.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(UserError, match="choose another folder"):
        evaluate(["expert"], "ally-v1", tmp_path, rounds=3)


def test_a_failed_evaluation_claims_no_folder(tmp_path):
    (tmp_path / "evaluation.json").write_text('{"panel": "opponent-v1", "panel_hash": "0", "rounds": 2}')
    (tmp_path / "rows.jsonl").touch()
    assert evaluate(["idle"], "ally-v1", tmp_path, rounds=1)


def test_code_that_has_changed_is_not_taken_for_what_was_played(panel, tmp_path, monkeypatch):
    source = tmp_path / "wobbly.py"
    source.write_text(
        "from fpg_bench.players.scripted import Scripted\n\ndef mine(s): return Scripted('ally', 'idle', s)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    play(panel, tmp_path / "rows.jsonl", "wobbly:mine")
    play(panel, tmp_path / "rows.jsonl", "wobbly:mine")
    source.write_text(source.read_text() + "\n# changed\n")
    with pytest.raises(UserError, match="its file has changed"):
        play(panel, tmp_path / "rows.jsonl", "wobbly:mine")


def test_no_agent_goes_by_the_name_of_a_script(panel):
    with pytest.raises(UserError, match="is a script's"):
        contestant("idle", "ally", panel, name="expert")


@pytest.mark.parametrize("line", ["[1]", '{"x": 1}'])
def test_lines_that_are_no_rows(panel, tmp_path, line):
    (tmp_path / "rows.jsonl").write_text(line + "\n")
    with pytest.raises(UserError, match="line 1 is no row"):
        play(panel, tmp_path / "rows.jsonl")


def test_opponent_panels_score_the_opponent(tmp_path):
    best, last = evaluate(["adaptive", "random"], "opponent-learned-v1", tmp_path, rounds=2)
    assert best.player == "adaptive"
    assert last.measures["near_ratio"] < 0.1 < best.measures["near_ratio"]


def test_results_of_another_version_are_refused(tmp_path):
    evaluate(["idle"], "ally-v1", tmp_path, rounds=1)
    about = json.loads((tmp_path / "evaluation.json").read_text())
    (tmp_path / "evaluation.json").write_text(json.dumps(about | {"panel_hash": "0"}))
    with pytest.raises(UserError, match="another version"):
        read_results(tmp_path)
