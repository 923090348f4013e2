"""Rows that were copied, or lost a value, are one clear line wherever they are read."""

import dataclasses
import json

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import read_records
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summary_of


@pytest.fixture(scope="module")
def suite():
    return dataclasses.replace(load_suite("ally-v2"), matches=1)


@pytest.fixture(scope="module")
def records(suite):
    return [play(player_entry("idle"), suite, rival) for rival in suite.rivals]


def test_a_meeting_that_is_told_of_twice_is_named(records):
    rows = [json.loads(json.dumps(record.row())) for record in records]
    assert read_records(rows, "here") == records
    with pytest.raises(UserError, match=f"here: record {len(rows) + 1} is of the same matchup as record 1"):
        read_records([*rows, rows[0] | {"lost": 1}], "here")


def test_an_entry_with_and_without_a_training_seed_is_named(records, suite):
    seeded = [dataclasses.replace(record, training_seed=3) for record in records]
    assert summary_of(seeded, suite).training_seeds == 1
    with pytest.raises(UserError, match="idle has records with and without a training seed"):
        summary_of([*seeded[1:], records[0]], suite)


@pytest.mark.parametrize("row", [{}, {"side": None, "score": 1}, {"side": "ally"}, {"side": [], "score": 1}])
def test_a_row_that_lacks_what_it_needs_is_named(tmp_path, row):
    file = RowFile(tmp_path / "rows.jsonl", {"side": str, "score": float | int})
    file.append([{"side": "ally", "score": 1.5}, row])
    with pytest.raises(UserError, match=r"line 2: (side|score) is missing or has the wrong type"):
        file.read()
