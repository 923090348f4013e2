"""The page on entering a planner: its commands are run, on a small suite in place of the track's."""

from __future__ import annotations

import json

import pytest
import yaml

from fpg_bench.leaderboard.tracks import TRANSCRIPT_MATCHES
from fpg_bench.leaderboard.transcripts import LARGEST_FOLDER
from fpg_bench.planning.llm.transcript import MOST_BYTES
from tests.pages import Reader, blocks
from tests.planning.llm.fault_server import FaultServer, answer
from tests.programs import ROOT

from .entering import make_suites
from .recording import toy

FILE = ROOT / "docs/benchmark/submitting-planners.md"
PAGE = FILE.read_text()
ENTRY = "leaderboard/submissions/planner/my-model"


@pytest.mark.process
def test_every_command_works_in_the_order_of_the_page(tmp_path):
    with FaultServer([answer(toy)]) as server:
        reader = Reader(tmp_path, make_suites(tmp_path / "baselines"), FPG_LLM_BASE_URL=server.url)
        for language, code in blocks(PAGE):
            if language == "yaml":
                reader.writes(f"{ENTRY}/submission.yaml", code)
            small = code.replace(f"--matches {TRANSCRIPT_MATCHES}", "")
            for _ in range(2 if "gzip" in code else 1):  # what was recorded anew is taken in, too
                reader.does(language, small)
    assert len(reader.ran) == 10
    result = (tmp_path / "leaderboard/results/planner/my-model.jsonl").read_text()
    head, *kept = map(json.loads, result.splitlines())
    assert (head["status"], head["fingerprint"]["planner"]["model"]) == ("verified", "my-model")
    records = (tmp_path / "runs/again/records.jsonl").read_text().splitlines()
    again = [record for record in map(json.loads, records) if record["entry"] == "transcripts"]
    assert [record["rounds_sha256"] for record in again] == [record["rounds_sha256"] for record in kept]


def test_the_page_s_numbers_are_the_code_s():
    assert f"--matches {TRANSCRIPT_MATCHES}" in PAGE
    assert f"first {TRANSCRIPT_MATCHES} matches" in PAGE
    assert f"{LARGEST_FOLDER // 10**6} MB in all, {MOST_BYTES // 10**6} MB a transcript" in PAGE
    (block,) = [code for language, code in blocks(PAGE) if language == "yaml"]
    assert yaml.safe_load(block)["track"] == "planner"
