"""The page on entering a player: its snippets are run in their order, with small budgets."""

from __future__ import annotations

import pytest

from fpg_bench.leaderboard import submission
from fpg_bench.leaderboard.submission import problems, read_about
from fpg_bench.players.sandbox import client, onnx_checks
from fpg_bench.players.sandbox.client import Limits
from tests.pages import Reader, blocks, small, small_baselines
from tests.programs import ROOT

FILE = ROOT / "docs/benchmark/submitting.md"
PAGE = FILE.read_text()
ENTRY = "leaderboard/submissions/ally/my-agent"


def few(code):
    """One training, where the page has three or five."""
    return small(code.replace("(0, 1, 2)", "(0,)").replace("seeds: [0, 1, 2, 3, 4]", "seeds: [0, 3, 4]"))


@pytest.fixture(scope="module")
def entered(tmp_path_factory):
    """What has come of the page's snippets, but for the verdict, which has tests of its own."""
    folder = tmp_path_factory.mktemp("page")
    reader = Reader(folder / "here", small_baselines(folder / "baselines"))
    for language, code in blocks(PAGE):
        if language == "yaml":
            reader.writes(f"{ENTRY}/submission.yaml", few(code))
        else:
            reader.does(language, few(code))
    return folder / "here", reader.said


@pytest.mark.process
def test_the_page_s_snippets_make_a_sound_submission(entered):
    folder, output = entered
    assert problems(folder / ENTRY) == []
    assert output.count("from the model's own predict") == 1
    assert "largest difference to predict: " in output
    assert f"\n{ENTRY}: nothing is wrong\n" in output
    assert "crossplay: 0 of 0 pairs to play\n" in output
    assert "ally/my-agent: left out: has no result" in output


def test_every_key_is_told_of():
    _, wrong = read_about({})
    assert [line for line in wrong if f"`{line.removeprefix('lacks ').strip(chr(39))}`" not in PAGE] == []


def test_the_page_s_limits_are_the_code_s():
    assert f"| {client.MOST_BYTES // 10**6} MB |" in PAGE
    assert f"| {onnx_checks.MOST_MULTIPLY_ADDS:,};" in PAGE
    assert f"{onnx_checks.MOST_NODES:,} at most" in PAGE
    assert f"| {submission.MOST_TEXT_BYTES // 1000} kB each" in PAGE
    limits = Limits()
    assert f"| {limits.memory_bytes >> 30} GB |" in PAGE
    each = f"{limits.call_s:g} s an answer and {limits.row_s:g} s a game in it"
    assert f"| {each}, {limits.total_s / 60:g} minutes in all" in PAGE
