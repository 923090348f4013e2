"""Pictures of results tables."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.table import lines_of_table, write_table
from fpg_bench.products.rendering.scores import draw_scores
from tests.evaluation import test_table
from tests.evaluation.test_summary import records_of

suite, summaries = test_table.suite, test_table.summaries


def test_a_figure_is_written_by_its_suffix(summaries, suite, tmp_path):
    for suffix, begins in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")):
        draw_scores(summaries, suite, tmp_path / f"table.{suffix}")
        assert (tmp_path / f"table.{suffix}").read_bytes().startswith(begins)
    with pytest.raises(UserError, match=r"a figure is written as \.png, \.svg, \.pdf"):
        draw_scores(summaries, suite, tmp_path / "table.gif")


def test_a_column_that_says_nothing_is_left_out():
    planned = dataclasses.replace(load_suite("planner-v1"), matches=1)
    found = summarise(records_of(planned, "circle", 1.0), planned)
    assert "valid %" not in lines_of_table(found, planned, 200)[0]
    assert "valid %" in lines_of_table(found, planned)[0]


def test_the_files_of_a_table_hold_a_picture(summaries, suite, tmp_path):
    write_table(summaries, suite, tmp_path)
    assert (tmp_path / "table.png").read_bytes().startswith(b"\x89PNG")
