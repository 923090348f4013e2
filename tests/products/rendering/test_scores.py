"""Pictures of results tables."""

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.rendering.scores import draw_scores
from tests.evaluation import test_table

suite, summaries = test_table.suite, test_table.summaries


def test_a_figure_is_written_by_its_suffix(summaries, suite, tmp_path):
    for suffix, begins in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")):
        draw_scores(summaries, suite, tmp_path / f"table.{suffix}")
        assert (tmp_path / f"table.{suffix}").read_bytes().startswith(begins)
    with pytest.raises(UserError, match=r"a figure is written as \.png, \.svg, \.pdf"):
        draw_scores(summaries, suite, tmp_path / "table.gif")
