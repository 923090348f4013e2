"""Evaluations whose entries are played at once."""

import json
import shutil

import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation import shards
from fpg_bench.evaluation.evaluate import evaluate, read_results
from fpg_bench.evaluation.table import write_table
from fpg_bench.rows import RowFile
from tests.evaluation.zoo_making import make_agent, make_zoo


@pytest.fixture(scope="module")
def zoo(tmp_path_factory):
    return make_zoo(tmp_path_factory.mktemp("zoo"))


@pytest.fixture
def play(zoo, tmp_path):
    """Evaluates players and gives the rows, sorted."""

    def run(players, out, **words):
        evaluate(players, zoo.views[0].panel, tmp_path / out, say=lambda line: None, **words)
        return sorted(map(json.dumps, RowFile(tmp_path / out / "rows.jsonl").read()))

    return run


def test_the_rows_and_the_table_are_the_same_to_the_bit(zoo, play, tmp_path):
    agents = [str(make_agent(member, tmp_path / member.name)) for member in zoo.members("small/ppo")]
    players = [*agents, "expert", "idle", "expert"]
    assert play(players, "many", jobs=2) == play(players, "one")
    for out in ("many", "one"):
        write_table(*read_results(tmp_path / out), tmp_path / out)
    assert (tmp_path / "many" / "table.csv").read_text() == (tmp_path / "one" / "table.csv").read_text()


def test_only_what_is_missing_is_played(play, tmp_path):
    rows = play(["expert"], "out", jobs=2)
    file = tmp_path / "out" / "rows.jsonl"
    kept = file.read_text().splitlines(keepends=True)
    file.write_text("".join(kept[:5]) + kept[5][:20])  # one entry whole, one begun, the last line torn
    assert play(["expert"], "out", jobs=2) == rows
    assert file.read_text().startswith("".join(kept[:5]))


def test_a_player_that_fails_does_not_hold_up_the_others(play, tmp_path, monkeypatch):
    source = "class Bad:\n    def predict(self, *a, **k):\n        raise RuntimeError('no idea')\n"
    (tmp_path / "bad.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UserError, match=r"bad:Bad - adaptive/pursuit: .*no idea \(and 1 more failed\)"):
        play(["bad:Bad", "expert"], "out", jobs=2)
    rows = RowFile(tmp_path / "out" / "rows.jsonl").read()
    assert {row["player"] for row in rows} == {"expert"}
    assert len(rows) == 8


def test_two_players_of_one_name(zoo, play, tmp_path):
    member = zoo.members("small/ppo")[0]
    agents = [make_agent(member, tmp_path / name, seed=seed) for seed, name in enumerate("ab")]
    with pytest.raises(UserError, match="ppo/seed_0: is the name of two players"):
        play(list(map(str, agents)), "out", jobs=2)


def test_an_agent_travels_to_the_worker(zoo, play, tmp_path, monkeypatch):
    folder = make_agent(zoo.members("small/ppo")[0], tmp_path / "agent")
    expected = play([str(folder)], "one")
    run_jobs = shards.run_jobs

    def run(*words):
        shutil.rmtree(folder)
        return run_jobs(*words)

    monkeypatch.setattr(shards, "run_jobs", run)
    assert play([str(folder)], "many", jobs=2) == expected
