"""The script that makes the table of offline algorithms."""

import hashlib
import json
import re

import pytest
import train_offline as script

from fpg_bench.common.rows import RowFile


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / "page.md").write_text("before\n\n<!-- scores -->\nold\n<!-- end -->\n\nafter\n")
    for name, value in {
        "ROWS": tmp_path / "scores.jsonl",
        "PAGE": tmp_path / "page.md",
        "DATASETS": {"ally-random-v0": "ally-scripted"},
        "OFFLINE": ("bc", "discrete-cql"),
        "TRANSITIONS": 900,
    }.items():
        monkeypatch.setattr(script, name, value)
    return tmp_path


def run(folder):
    script.main("0-2", 20, folder / "data", folder / "runs")


@pytest.mark.full
@pytest.mark.slow
def test_agents_are_trained_and_scored_once_and_stand_in_the_table(here, monkeypatch):
    monkeypatch.setattr(script, "ENOUGH_SEEDS", 3)
    run(here)
    rows = [json.loads(line) for line in (here / "scores.jsonl").read_text().splitlines()]
    found = [(row["algorithm"], row["training_seed"]) for row in rows]
    assert found == [("behaviour", None), ("bc", 0), ("bc", 1), ("bc", 2)]
    assert {row.get("steps") for row in rows} == {None, 20}
    policies = [here / f"runs/ally-random-v0/bc/seed_{seed}/agent/policy.onnx" for seed in range(3)]
    hashes = [hashlib.sha256(policy.read_bytes()).hexdigest() for policy in policies]
    assert [row["policy_sha256"] for row in rows[1:]] == hashes
    mean = sum(row["score"] for row in rows[1:]) / 3
    text = (here / "page.md").read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    (line,) = (line for line in text.splitlines() if line.startswith("| `ally-random-v0` | ally-v2 |"))
    assert f"| {script.number(rows[0]['score'])} | {mean:.1f} [" in line
    assert "old" not in text
    few = " {}, {} |".format(*(script.number(row["score"]) for row in rows[1:3]))
    assert few in script.score_table(rows[:3])
    monkeypatch.setattr(script, "train", None)
    monkeypatch.setattr(script, "play", None)
    run(here)  # nothing is repeated


@pytest.mark.slow
def test_the_table_of_the_guide_is_that_of_the_rows():
    rows = RowFile(script.ROWS).read()
    table = script.PAGE.read_text().split("<!-- scores -->")[1].split("<!-- end -->")[0]
    assert table.strip() == script.score_table(rows).strip()
    trained = [row for row in rows if row["algorithm"] != script.BEHAVIOUR]
    assert all(re.fullmatch(r"[0-9a-f]{64}", row["policy_sha256"]) for row in trained)
