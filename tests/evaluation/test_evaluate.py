"""From players' names to a results folder, alone and many at once."""

import contextlib
import json
import re
import shutil
import sys
from types import SimpleNamespace

import pytest

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import entries_of
from fpg_bench.evaluation.evaluate import evaluate, play_into, read_results
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import TrainingCost
from fpg_bench.evaluation.table import caption, write_table
from fpg_bench.players.agent import load_agent
from fpg_bench.players.scripted import Scripted
from tests.training.making import SUITE, make_agent, make_zoo


@pytest.fixture
def suite(tmp_path, monkeypatch):
    """The name of a suite of two rivals, where the test runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yml").write_text(SUITE)
    return "small.yml"


@pytest.fixture
def agents(tmp_path):
    """Three training seeds of one entry."""
    zoo = make_zoo(tmp_path)
    return [str(make_agent(member, tmp_path / "agents" / member.name)) for member in zoo.members("small/ppo")]


def rows(folder):
    return sorted(map(json.dumps, RowFile(folder / "records.jsonl").read()))


def test_a_line_per_training_seed_and_rival(suite, agents, tmp_path):
    found = evaluate([*agents, "expert"], suite, tmp_path / "out")
    assert {(s.entry, s.training_seeds) for s in found} == {("expert", 0), ("ppo", 3)}
    records = RowFile(tmp_path / "out" / "records.jsonl").read()
    assert len(records) == 4 * 2
    assert {(record["entry"], record["training_seed"]) for record in records} == {
        ("expert", None),
        *(("ppo", k) for k in range(3)),
    }
    again, played = read_results(tmp_path / "out")
    assert [s.records for s in again] == [s.records for s in found]
    assert played.hash == load_suite(suite).hash


def test_the_cost_of_training_is_kept_beside_the_records(suite, tmp_path):
    out = tmp_path / "out"
    evaluate(["ally-scripted/ppo/seed_0", "ally-scripted/ppo/seed_1", "idle"], suite, out, matches=1)
    summaries = {summary.entry: summary for summary in read_results(out)[0]}
    costs = [load_agent(f"ally-scripted/ppo/seed_{seed}").card for seed in (0, 1)]
    mean = sum(card.seconds for card in costs) / 2
    assert costs[0].steps_done == 3_002_368  # whole rollouts
    assert summaries["ppo"].training == TrainingCost(3_002_368, pytest.approx(mean))
    assert summaries["idle"].training == TrainingCost()
    about = json.loads((out / "evaluation.json").read_text())
    for training in ({"ppo": 3}, {"ppo": {"0": {"steps": "3M"}}}, []):
        (out / "evaluation.json").write_text(json.dumps(about | {"training": training}))
        with pytest.raises(UserError, match=r"evaluation\.json: training.*: expected a .*, got"):
            read_results(out)


def test_results_of_another_suite_number_or_version_are_refused(suite, tmp_path):
    out = tmp_path / "out"
    evaluate(["idle"], suite, out)
    with pytest.raises(UserError, match=r"of small.yml with 4 matches, .* with 3; choose another folder"):
        evaluate(["idle"], suite, out, matches=3)
    about = json.loads((out / "evaluation.json").read_text())
    (tmp_path / "small.yml").write_text(SUITE.replace("circle", "triangle"))
    with pytest.raises(UserError, match="or of another version of it"):
        evaluate(["idle"], suite, out)
    with pytest.raises(UserError, match=r"another version of small.yml; evaluate again"):
        read_results(out)
    (out / "evaluation.json").write_text(json.dumps(about | {"suite": "smal"}))
    with pytest.raises(UserError, match="unknown suite 'smal'"):
        read_results(out)


def test_a_folder_whose_description_is_no_evaluations_is_named(suite, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "rows.jsonl").write_text('{"player": "expert"}\n')
    for about in ({"suite": "ally-v2", "panel_hash": "0", "rounds": 2}, {"suite": 5}, {}):
        (out / "evaluation.json").write_text(json.dumps(about))
        for use in (lambda: read_results(out), lambda: evaluate(["idle"], suite, out)):
            with pytest.raises(
                UserError, match=r"out: evaluation\.json: .*; evaluate again into another folder"
            ):
                use()
        assert json.loads((out / "evaluation.json").read_text()) == about


def test_a_run_without_results_is_told_from_a_results_folder(tmp_path):
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(
        UserError, match="is a training run without results; play it first: fpg-bench evaluate"
    ):
        read_results(tmp_path)


def test_an_evaluation_that_never_began_claims_no_folder(suite, tmp_path):
    with contextlib.suppress(UserError):
        evaluate(["expertt"], suite, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    about = {"suite": "opponent-v2", "suite_hash": "0", "matches": 2}
    (tmp_path / "out" / "evaluation.json").write_text(json.dumps(about))
    (tmp_path / "out" / "records.jsonl").touch()
    assert evaluate(["idle"], suite, tmp_path / "out")


def test_lines_that_are_broken_or_of_another_suite_are_one_clear_error(suite, tmp_path):
    evaluate(["idle"], suite, tmp_path / "out")
    file = tmp_path / "out" / "records.jsonl"
    text = file.read_text()
    for more in ("[1]\n", '{"x": 1}\n', "{\n"):
        file.write_text(text + more)
        with pytest.raises(UserError, match=r"(line|record) 3"):
            evaluate(["idle"], suite, tmp_path / "out")
    file.write_text(text.replace(load_suite(suite).hash[:16], "0" * 16))
    with pytest.raises(UserError, match=r"holds some of another suite \(small\); choose another folder"):
        evaluate(["idle"], suite, tmp_path / "out")


SCRIPT = "from fpg_bench.players.scripted import Scripted\n\ndef mine(s): return Scripted('ally', {}, s)\n"


@pytest.fixture
def package(tmp_path):
    """A package whose ``__init__`` re-exports a player that a module beside it and a text file decide."""
    (tmp_path / "wobbly").mkdir()
    (tmp_path / "wobbly/__init__.py").write_text("from wobbly.inner import mine\n")
    (tmp_path / "wobbly/inner.py").write_text("import wobbly_help\n" + SCRIPT.format("wobbly_help.name()"))
    (tmp_path / "wobbly_help.py").write_text("def name(): return open('weights.txt').read()\n")
    (tmp_path / "weights.txt").write_text("idle")
    yield tmp_path
    for name in ("wobbly", "wobbly.inner", "wobbly_help"):
        sys.modules.pop(name, None)


def test_a_player_of_code_is_played_again_unless_it_may_be_reused(suite, package):
    (first,) = evaluate(["wobbly:mine"], suite, "out")
    evaluate(["random"], suite, "out")
    (package / "weights.txt").write_text("expert")
    kept = evaluate(["wobbly:mine"], suite, "out", reuse=True)
    assert {each.entry: each.score for each in kept}["wobbly:mine"] == first.score
    found = {each.entry: each for each in evaluate(["wobbly:mine"], suite, "out")}
    assert found["wobbly:mine"].score == evaluate(["expert"], suite)[0].score != first.score
    assert found.keys() == {"wobbly:mine", "random"}
    assert re.search(
        r"Code, .*: wobbly:mine \(20\d\d-.* UTC\)\.", caption([*found.values()], load_suite(suite))
    )
    assert "Code" not in caption([found["random"]], load_suite(suite))


@pytest.mark.parametrize("file", ["wobbly/__init__.py", "wobbly/inner.py", "wobbly_help.py"])
def test_reused_code_is_the_same_in_all_modules_of_its_own(suite, package, file):
    evaluate(["wobbly:mine"], suite, "out")
    evaluate(["wobbly:mine"], suite, "out", reuse=True)
    (package / file).write_text((package / file).read_text() + "\n# changed\n")
    with pytest.raises(UserError, match="its file has changed"):
        evaluate(["wobbly:mine"], suite, "out", reuse=True)


def test_rivals_of_code_count_by_their_content(suite, package):
    (package / "wobbly/inner.py").write_text(SCRIPT.format("'tone'").replace("ally", "opponent"))
    (package / suite).write_text(SUITE.replace("opponent: adaptive", "opponent: wobbly:mine"))
    options = {"allow": ["wobbly:mine"]}
    evaluate(["idle"], suite, "out", **options)
    with pytest.raises(UserError, match=r"records against code \(wobbly:mine\).*; add --reuse"):
        evaluate(["random"], suite, "out", **options)
    found = evaluate(["random"], suite, "out", reuse=True, **options)
    assert all(each.played for each in found)
    (package / "wobbly/inner.py").write_text(SCRIPT.format("'sweep'").replace("ally", "opponent"))
    with pytest.raises(UserError, match="another version"):
        evaluate(["expert"], suite, "out", reuse=True, **options)
    with pytest.raises(UserError, match="another version"):
        read_results("out")


def test_agents_of_another_policy_or_budget_are_not_merged_by_a_second_command(suite, agents, tmp_path):
    evaluate(agents[:1], suite, tmp_path / "out")
    zoo = make_zoo(tmp_path)
    other = str(make_agent(zoo.members()[1], tmp_path / "other", training_steps=5))
    with pytest.raises(UserError, match="hold 'ppo' with another budget, other hyper-parameters or other"):
        evaluate([other], suite, tmp_path / "out")
    found = evaluate([f"mine={other}"], suite, tmp_path / "out")
    assert {s.entry for s in found} == {"ppo", "mine"}
    found = evaluate(agents[1:], suite, tmp_path / "out")  # more seeds of the first join it
    assert {(s.entry, s.training_seeds) for s in found} == {("ppo", 3), ("mine", 1)}
    shutil.rmtree(agents[0])
    make_agent(zoo.members()[0], tmp_path / "agents" / zoo.members()[0].name, seed=77)
    with pytest.raises(UserError, match=r"holds records of another 'ppo' \(another policy, or its"):
        evaluate(agents, suite, tmp_path / "out")


def test_a_second_command_adds_no_policy_as_another_training_seed(suite, agents, tmp_path):
    evaluate(agents[:1], suite, tmp_path / "out")
    copy = make_agent(make_zoo(tmp_path).members()[0], tmp_path / "copy", training_seed=7)
    with pytest.raises(UserError, match="ppo: seed_7: holds the same policy as seed_0"):
        evaluate([str(copy)], suite, tmp_path / "out")
    assert len(rows(tmp_path / "out")) == 2


def test_a_suite_of_planners_takes_planners_alone(tmp_path):
    with pytest.raises(UserError, match="unknown planner 'idle'"):
        evaluate(["idle"], "planner-v1", tmp_path / "out")
    with pytest.raises(UserError, match="unknown ally 'hold'"):
        evaluate(["hold"], "ally-v2", tmp_path / "out")
    (still,) = evaluate({"still": "hold"}, "planner-v1", matches=1)
    assert (still.entry, still.pooled.plans.statuses["ok"]) == ("still", 50)


# From Python


def test_one_call_from_python_gives_a_table_and_keeps_nothing(suite, tmp_path):
    mine = Scripted("ally", "idle", load_suite(suite).scenario)
    before = sorted(path.name for path in tmp_path.iterdir())
    found = fpg_bench.evaluate({"mine": mine, "random": "random"}, suite)
    assert [s.entry for s in found] == ["mine", "random"]
    assert found.table().splitlines()[2].startswith("| mine | - | ")
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    by_name = fpg_bench.evaluate(["idle"], suite)
    assert by_name[0].score == found[0].score
    with pytest.raises(UserError, match="mine: a folder keeps records of players by their names"):
        fpg_bench.evaluate({"mine": mine}, suite, tmp_path / "out")


def test_results_show_themselves_as_tables(suite, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    found = fpg_bench.evaluate({"a<b>[red]": "random", "still": "idle"}, suite)
    text = repr(found)
    assert all(len(line) <= 80 for line in text.splitlines())
    assert len(text) < 2000
    assert re.search(r"(?m)^ *player .* score", text)
    assert "a<b>[red]" in text
    assert len(repr(found[0])) < 100
    page = found._repr_html_()
    assert page.count("<tr>") == 3
    assert "<td>a&lt;b&gt;[red]</td>" in page
    assert "<b>" not in page
    assert found[0].suite.hash[:12] in page


def test_a_dataframe_has_a_row_per_entry_and_needs_pandas_alone(suite, monkeypatch):
    """pandas is not asked for: a stand-in takes what its DataFrame would."""
    results = fpg_bench.evaluate(["random", "idle"], suite)
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=list))
    found = results.dataframe()
    assert [row["entry"] for row in found] == ["idle", "random"]
    assert {"score", "score_low", "return_per_step sweep/circle", "hop_rate"} <= found[0].keys()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UserError, match=r"pandas is not installed: pip install .*\[dataframe\]"):
        results.dataframe()


# Many at once


@pytest.mark.slow
def test_many_at_once_give_the_same_rows_and_a_player_that_fails_holds_up_nobody(
    suite, agents, tmp_path, monkeypatch
):
    source = "class Bad:\n    def predict(self, *a, **k):\n        raise RuntimeError('no idea')\n"
    (tmp_path / "bad.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    loaded = load_suite(suite)
    bad, *entries = entries_of(["bad:Bad", *agents, "expert", "idle", "expert"], loaded)
    play_into(tmp_path / "one", suite, loaded, entries)
    shutil.rmtree(agents[0])  # its policy travels to the workers
    with pytest.raises(UserError, match=r"bad:Bad - adaptive/pursuit: .*no idea, .*, line 3 \(and 1 more"):
        play_into(tmp_path / "many", suite, loaded, [bad, *entries], workers=2)
    assert rows(tmp_path / "many") == rows(tmp_path / "one")
    for out in ("many", "one"):
        write_table(*read_results(tmp_path / out), tmp_path / out)
    assert (tmp_path / "many" / "table.csv").read_text() == (tmp_path / "one" / "table.csv").read_text()


def test_a_file_in_the_place_of_the_results_folder_is_refused_by_name(tmp_path):
    (tmp_path / "mine").write_text("")
    with pytest.raises(UserError, match=r"out: .*mine is a file; name a folder"):
        evaluate(["expert"], "ally-v2", tmp_path / "mine", matches=1)


def test_a_folder_with_a_bad_record_can_be_mended(suite, tmp_path):
    evaluate(["idle"], suite, tmp_path / "out")
    file = tmp_path / "out" / "records.jsonl"
    whole = file.read_text()
    file.write_text(whole.replace('"entry":"idle"', '"entry":""', 1))
    with pytest.raises(UserError, match=r"record 1: .*; without its line it is played again"):
        evaluate(["idle"], suite, tmp_path / "out")
    file.write_text("".join(file.read_text().splitlines(keepends=True)[1:]))
    evaluate(["idle"], suite, tmp_path / "out")
    assert sorted(file.read_text().splitlines()) == sorted(whole.splitlines())


def test_a_refused_player_leaves_nothing_in_the_folder(suite, tmp_path):
    evaluate({"mine": "idle"}, suite, tmp_path / "out")
    before = (tmp_path / "out" / "evaluation.json").read_bytes()
    with pytest.raises(UserError, match="records of another 'mine'"):
        evaluate({"mine": "ally-scripted/ppo/seed_0"}, suite, tmp_path / "out")
    assert (tmp_path / "out" / "evaluation.json").read_bytes() == before


def test_names_are_drawn_as_they_are(suite, tmp_path):
    results = evaluate({r"a $\frac$": "idle", "b $x$": "random"}, suite)
    write_table(results, load_suite(suite), tmp_path)
    assert (tmp_path / "table.png").exists()
