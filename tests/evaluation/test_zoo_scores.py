import dataclasses
import hashlib
import json

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.zoo_scores import (
    add_missing_lines,
    check_member,
    complete,
    differences,
    first_returns,
    read_lines,
    score_arrays,
    score_file,
    score_lines,
    seed_scores,
    summarise_lines,
)
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from tests.evaluation.zoo_making import make_agent, make_zoo

HEAD = {"algorithm": "expert", "training_seed": None, "policy_sha256": None}


@pytest.fixture(scope="module")
def zoo(tmp_path_factory):
    zoo = make_zoo(tmp_path_factory.mktemp("zoo"))
    for member in zoo.members():
        make_agent(member, seed=member.seed + 10 * (member.algorithm == "td3"))
    add_missing_lines(zoo, zoo.views[0])
    return zoo


@pytest.fixture(scope="module")
def panel(zoo):
    return load_panel(zoo.views[0].panel)


def lines_of(zoo, panel, algorithm):
    return [line for line in read_lines(zoo, zoo.views[0], panel) if line["algorithm"] == algorithm]


def test_a_line_per_entry_sums_up_the_rows_that_evaluate_writes(zoo, panel, tmp_path):
    lines = score_lines("expert", panel, HEAD)
    evaluate(["expert"], zoo.views[0].panel, tmp_path)
    rows = RowFile(tmp_path / "rows.jsonl").read()
    assert [line["entry"] for line in lines] == [entry.name for entry in panel.entries]
    for line in lines:
        mine = [row for row in rows if row["entry"] == line["entry"]]
        assert line["n"] == len(mine) == panel.rounds
        assert line["returns"] == pytest.approx([row["ally_return"] for row in mine], abs=1e-3)
        hops = np.array([row["hops"] / row["steps"] for row in mine])
        assert line["mean"]["hop_rate"] == pytest.approx(hops.mean(), rel=1e-4)
        assert line["sd"]["hop_rate"] == pytest.approx(hops.std(ddof=1), rel=1e-4)
        bare = [{key: row[key] for key in list(row)[list(row).index("seed") :]} for row in mine]
        text = "".join(json.dumps(row) + "\n" for row in bare)
        assert line["rows_sha256"] == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("name", ["ally-v1", "ally-planner-v1"])
def test_first_returns_begin_a_line(name):
    panel = load_panel(name)
    few = dataclasses.replace(panel, rounds=12, entries=panel.entries[:2])
    for line, entry in zip(score_lines("expert-spread", few, HEAD), few.entries, strict=True):
        assert first_returns("expert-spread", few, entry) == line["returns"][:2]


def test_everybody_has_lines_and_nobody_twice(zoo, panel):
    lines = read_lines(zoo, zoo.views[0], panel)
    assert len(lines) == 2 * (len(SCRIPTED["ally"]) + 6)
    size = score_file(zoo, zoo.views[0]).path.stat().st_size
    scored = []
    assert add_missing_lines(zoo, zoo.views[0], scored.append) == lines
    assert scored == []
    assert score_file(zoo, zoo.views[0]).path.stat().st_size == size


def test_a_summary_of_lines_is_that_of_the_rows(zoo, panel, tmp_path):
    agents = [str(member.folder) for member in zoo.members("small/ppo")]
    expected = evaluate([*agents, "expert", "idle"], zoo.views[0].panel, tmp_path)
    found = {s.player: s for s in summarise_lines(read_lines(zoo, zoo.views[0], panel), panel)}
    for summary in expected:
        mine = found[summary.player]
        assert (mine.training_seeds, mine.rounds) == (summary.training_seeds, summary.rounds)
        ours, theirs = mine.score, summary.score
        assert (ours.value, ours.low, ours.high) == pytest.approx(
            (theirs.value, theirs.low, theirs.high), abs=1e-3
        )
        assert ours.over == theirs.over
        for name in ("overlap_ratio", "jamming_success_rate", "hop_rate", "ally_return"):
            assert mine.measures[name] == pytest.approx(summary.measures[name], rel=1e-4)


def test_scores_of_single_seeds(zoo, panel):
    lines = read_lines(zoo, zoo.views[0], panel)
    found = seed_scores(lines, panel)
    assert set(found) == {(algorithm, k) for algorithm in ("ppo", "td3") for k in range(3)}
    scores = score_arrays(lines, panel)["td3"].mean(axis=2)
    assert found["td3", 1] == pytest.approx(scores[1].mean())  # of two entries none is left out


def test_an_agent_that_is_replaced_is_scored_again(tmp_path):
    zoo = make_zoo(tmp_path)
    member, panel = zoo.members()[0], load_panel(zoo.views[0].panel)
    make_agent(member)
    add_missing_lines(zoo, member.view)
    before = lines_of(zoo, panel, "ppo")
    assert check_member(zoo, member) == []
    for file in member.folder.iterdir():
        file.unlink()
    member.folder.rmdir()
    make_agent(member, seed=77)
    assert lines_of(zoo, panel, "ppo") == []
    assert check_member(zoo, member) == ["adaptive/pursuit: no line", "sweep/circle: no line"]
    scored = []
    add_missing_lines(zoo, member.view, scored.append)
    assert scored == [member.name]
    after = lines_of(zoo, panel, "ppo")
    assert differences(after, before) == ["adaptive/pursuit: other returns", "sweep/circle: other returns"]


def test_half_a_player_is_no_player(zoo, panel):
    lines = lines_of(zoo, panel, "ppo")
    assert len(complete(lines, panel)) == 6
    assert {line["training_seed"] for line in complete(lines[1:], panel)} == {1, 2}


def test_a_policy_that_has_changed_is_refused(tmp_path):
    zoo = make_zoo(tmp_path)
    member = zoo.members()[0]
    make_agent(member)
    (member.folder / "policy.onnx").write_bytes(b"torn")
    with pytest.raises(UserError, match="sha256"):
        add_missing_lines(zoo, member.view)


def test_other_rows_with_the_same_returns_are_told():
    line = {"entry": "a/b", "returns": [1.0], "rows_sha256": "x"}
    assert differences([line], [line]) == []
    assert differences([line], [line | {"rows_sha256": "y"}]) == ["a/b: the same returns, but other rows"]
