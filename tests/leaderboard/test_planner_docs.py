"""The page on entering a planner: its commands are run, on a small field in place of the track's."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from fpg_bench.leaderboard.tracks import TRANSCRIPT_MATCHES
from fpg_bench.leaderboard.transcripts import LARGEST_FOLDER
from fpg_bench.planning.llm import packed
from tests.planning.llm.fault_server import FaultServer, answer

from .entering import make_fields
from .recording import toy

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "submitting-planners.md").read_text()
ENTRY = "leaderboard/submissions/planner/my-model"

FPG_BENCH = """\
#!{python}
from pathlib import Path
from fpg_bench.players import agent
agent.baselines_folder = lambda: Path("{baselines}")
from fpg_bench.cli import main
main()
"""


@pytest.fixture
def environment(tmp_path):
    """A command that takes a small field for the track's."""
    baselines = make_fields(tmp_path / "baselines")
    command = tmp_path / "bin" / "fpg-bench"
    command.parent.mkdir()
    command.write_text(FPG_BENCH.format(python=sys.executable, baselines=baselines))
    command.chmod(0o755)
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("FPG_LLM_", "OPENAI_"))}
    paths = {"PATH": f"{command.parent}:{kept['PATH']}", "PYTHONPATH": str(ROOT)}
    return kept | paths


def test_every_command_works_in_the_order_of_the_page(tmp_path, environment):
    ran = []
    with FaultServer([answer(toy)]) as server:
        for language, code in re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL):
            if language == "yaml":
                (tmp_path / ENTRY / "submission.yaml").write_text(code)
                continue
            lines = code.strip().splitlines()
            for line in lines * 2 if "gzip" in code else lines:  # what was recorded anew is taken in, too
                if line.startswith("export "):
                    name, _, value = line.removeprefix("export ").partition("=")
                    environment[name] = server.url if name == "FPG_LLM_BASE_URL" else value
                    continue
                small = line.replace(f"--matches {TRANSCRIPT_MATCHES}", "")
                found = subprocess.run(
                    ["sh", "-c", small], cwd=tmp_path, env=environment, capture_output=True, text=True
                )
                assert found.returncode == 0, f"{line}\n{found.stdout}\n{found.stderr}"
                ran.append(line)
    assert len(ran) == 10
    result = (tmp_path / "leaderboard/results/planner/my-model.jsonl").read_text()
    head, *kept = map(json.loads, result.splitlines())
    assert (head["status"], head["fingerprint"]["planner"]["model"]) == ("verified", "my-model")
    lines = (tmp_path / "runs/again/lines.jsonl").read_text().splitlines()
    again = [line for line in map(json.loads, lines) if line["entry"] == "transcripts"]
    assert [line["rounds_sha256"] for line in again] == [line["rounds_sha256"] for line in kept]


def test_the_page_s_numbers_are_the_code_s():
    assert f"--matches {TRANSCRIPT_MATCHES}" in PAGE
    assert f"first {TRANSCRIPT_MATCHES} matches" in PAGE
    assert f"{LARGEST_FOLDER // 10**6} MB in all, {packed.MOST_BYTES // 10**6} MB a transcript" in PAGE
    (told,) = [
        code for language, code in re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL) if language == "yaml"
    ]
    assert yaml.safe_load(told)["track"] == "planner"


def test_links_lead_somewhere():
    for link in re.findall(r"\]\(([^)]+)\)", PAGE):
        file, _, anchor = link.partition("#")
        target = (ROOT / "docs" / file).read_text()
        headings = [
            heading.lower().replace(" ", "-") for heading in re.findall(r"^#+ (.+)$", target, re.MULTILINE)
        ]
        assert not anchor or anchor in headings, link
