"""The committed transcripts of the small model: replayed, they give the committed tables."""

import shutil

import pytest

from scripts import measure_language_model as script
from tests.programs import ROOT

COMMITTED = ROOT / "results/language-model"
TIMED = ("s per plan",)  # of planners that are no language models, measured anew


def columns(text):
    """The table's columns by their heads."""
    head, _, *rows = [line for line in text.splitlines() if line.startswith("|")]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in (head, *rows)]
    return {name: cells for name, *cells in zip(*lines, strict=True) if name not in TIMED}


@pytest.mark.slow
def test_the_transcripts_give_the_tables(tmp_path, capsys):
    shutil.copytree(COMMITTED / "transcripts", tmp_path / "transcripts")
    script.table([], tmp_path, tmp_path, matches=4)
    for name in ("differences.md", "speed.md"):
        assert (tmp_path / name).read_text() == (COMMITTED / name).read_text()
    found, known = (columns((folder / "table.md").read_text()) for folder in (tmp_path, COMMITTED))
    assert found == known


def test_the_page_says_what_the_tables_say():
    page = (ROOT / "docs/explanation/language-model.md").read_text()
    told = columns((COMMITTED / "table.md").read_text())
    missing = [score for score in told["score last 3"] if f" {score} [" not in page]
    assert told["planner"]
    assert missing == []
