"""The pages on entering players and planners: their snippets are run in their order, on small suites."""

from __future__ import annotations

import json

import pytest

from fpg_bench.products.language_models.transcript import MOST_BYTES
from fpg_bench.products.leaderboard import submission
from fpg_bench.products.leaderboard.about import read_about
from fpg_bench.products.leaderboard.tracks import TRANSCRIPT_MATCHES
from fpg_bench.products.leaderboard.transcripts import LARGEST_FOLDER
from fpg_bench.products.sandbox import client, onnx_checks
from fpg_bench.products.sandbox.client import ProcessLimits
from tests.pages import Reader, blocks, small, small_baselines
from tests.products.language_models.fault_server import FaultServer, answer
from tests.products.leaderboard.making import problems
from tests.programs import ROOT

from .entering import make_suites
from .recording import toy

PAGE = (ROOT / "docs/benchmark/submitting.md").read_text()
PLANNERS = (ROOT / "docs/benchmark/submitting-planners.md").read_text()
PLANNER_ENTRY = "leaderboard/submissions/planner/my-model"
ENTRY = "leaderboard/submissions/ally/my-agent"


def few(code):
    """One training, where the page has three or five."""
    return small(code.replace("(0, 1, 2)", "(0,)").replace("seeds: [0, 1, 2, 3, 4]", "seeds: [0, 3, 4]"))


@pytest.fixture(scope="module")
def entered(tmp_path_factory):
    """Run the page's snippets, but for `submit run`: `verify` plays the entry."""
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
    assert "largest difference from predict(): " in output
    assert f"\n{ENTRY}: nothing is wrong\n" in output
    assert "\n1 entries, " in output  # it stands on the board that is built


def test_every_key_is_told_of():
    _, wrong = read_about({})
    assert [line for line in wrong if f"`{line.removeprefix('lacks ').strip(chr(39))}`" not in PAGE] == []


def test_the_page_s_limits_are_the_code_s():
    assert f"| {client.MOST_BYTES // 10**6} MB |" in PAGE
    assert f"| {onnx_checks.MOST_MULTIPLY_ADDS:,};" in PAGE
    assert f"{onnx_checks.MOST_NODES:,} at most" in PAGE
    assert f"| {submission.MOST_TEXT_BYTES // 1000} kB each" in PAGE
    limits = ProcessLimits()
    assert f"| {limits.memory_bytes >> 30} GB |" in PAGE
    each = f"{limits.call_s:g} s an answer and {limits.row_s:g} s a game in it"
    assert f"| {each}, {limits.total_s / 60:g} minutes in all" in PAGE


@pytest.mark.process
def test_every_command_of_the_page_on_planners_works_in_its_order(tmp_path):
    with FaultServer([answer(toy)]) as server:
        reader = Reader(tmp_path, make_suites(tmp_path / "baselines"), FPG_LLM_BASE_URL=server.url)
        for language, code in blocks(PLANNERS):
            if language == "yaml":
                reader.writes(f"{PLANNER_ENTRY}/submission.yaml", code)
            short = code.replace(f"--matches {TRANSCRIPT_MATCHES}", "")
            for _ in range(2 if "gzip" in code else 1):  # what was recorded anew is taken in, too
                reader.does(language, short)
    assert len(reader.ran) == 10
    result = (tmp_path / "leaderboard/results/planner/my-model.jsonl").read_text()
    head, *kept = map(json.loads, result.splitlines())
    assert (head["status"], head["fingerprint"]["planner"]["model"]) == ("verified", "my-model")
    records = (tmp_path / "runs/again/records.jsonl").read_text().splitlines()
    again = [record for record in map(json.loads, records) if record["entry"] == "transcripts"]
    assert [record["rounds_sha256"] for record in again] == [record["rounds_sha256"] for record in kept]


def test_the_numbers_of_the_page_on_planners_are_the_code_s():
    assert f"--matches {TRANSCRIPT_MATCHES}" in PLANNERS
    assert f"first {TRANSCRIPT_MATCHES} matches" in PLANNERS
    assert f"{LARGEST_FOLDER // 10**6} MB in all, {MOST_BYTES // 10**6} MB a transcript" in PLANNERS
