"""Everything in the README and the planners' page is run: Python, commands (with small budgets), links.

A block whose first line is ``# NAME`` is a file. Language models are played by a server on loopback.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.planning.llm.fault_server import FaultServer, answer

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "docs/planners.md")
BUDGETS = (
    (r"(--steps |total_timesteps=|steps: )[\d_]+", r"\g<1>5000"),
    (r"fpg-bench train ", "fpg-bench train --evaluations 0 "),
    (r"tune ppo .*", r"\g<0> --trials 2 --steps 5000 --rounds 10"),
    (r"tune-write .*", r"\g<0> --best 1 --seeds 1"),
    (r"plan compare .*", r"\g<0> --matches 1"),
    (r"plan run .*", r"\g<0> --rounds 3"),
    (r"evaluate .*", r"\g<0> --matches 5"),
    (r"reproduce fig\d", "reproduce tables"),
)
WAYPOINTS = [{"x": 200 + 50 * i, "y": 700, "z": 300} for i in range(16)]


def text_of(page):
    return (ROOT / page).read_text()


def blocks(page):
    return re.findall(r"```(\w+)\n(.*?)```", text_of(page), re.DOTALL)


def small(text):
    """The same words with budgets that a test can bear."""
    for pattern, budget in BUDGETS:
        text = re.sub(pattern, budget, text)
    return text


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "bin").mkdir()
    fpg_bench = tmp_path / "bin" / "fpg-bench"
    fpg_bench.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m fpg_bench.cli "$@"\n')
    fpg_bench.chmod(0o755)
    return tmp_path


@pytest.fixture
def environment(folder):
    """The tests' own, but for the model that it may configure."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("FPG_LLM_", "OPENAI_"))}
    return kept | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}


@pytest.fixture
def language_model():
    with FaultServer([answer(lambda body: json.dumps({"waypoints": WAYPOINTS}))]) as server:
        yield server


@pytest.mark.parametrize("page", PAGES)
def test_every_block_works_in_the_order_of_the_page(page, folder, environment, language_model):
    ran = []
    for language, code in blocks(page):
        if named := re.match(r"# ([\w/-]+\.(?:py|ya?ml))\n", code):
            (folder / named[1]).parent.mkdir(parents=True, exist_ok=True)
            (folder / named[1]).write_text(small(code))
        if language == "yaml":
            continue
        for command in [code] if language == "python" else code.strip().splitlines():
            if command.startswith("make "):
                continue  # test_make_targets
            if command.startswith("export "):
                name, _, value = command.removeprefix("export ").partition("=")
                environment[name] = language_model.url if name == "FPG_LLM_BASE_URL" else value
                continue
            words = [sys.executable, "-c"] if language == "python" else ["sh", "-c"]
            run = [*words, small(command)]
            found = subprocess.run(run, cwd=folder, env=environment, capture_output=True, text=True)
            assert found.returncode == 0, f"{command}\n{found.stderr}"
            ran.append(command)
    assert len(ran) >= 10
    assert language_model.requests


def test_the_example_of_a_server_can_be_loaded(tmp_path):
    from fpg_bench.planning.llm.servers import load_server

    (code,) = [code for language, code in blocks("docs/planners.md") if "my_server.yml" in code]
    (tmp_path / "my_server.yml").write_text(code)
    assert load_server(str(tmp_path / "my_server.yml")).response_format == "json_schema"


def test_every_planner_and_every_server_profile_is_told_of():
    from fpg_bench.planning import PLANNERS
    from fpg_bench.planning.llm.servers import SERVERS

    text = text_of("docs/planners.md")
    assert [name for name in (*PLANNERS, *SERVERS) if f"`{name}`" not in text] == []


def test_make_targets():
    for target in ("benchmark", "test"):
        assert f"make {target}" in text_of("README.md")
        assert subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True).returncode == 0


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)]+)\)", text_of(page)):
        file, _, anchor = link.partition("#")
        target = (ROOT / page).parent / file if file else ROOT / page
        assert target.exists(), link
        headings = re.findall(r"^#+ (.+)$", target.read_text(), re.MULTILINE) if anchor else []
        assert not anchor or anchor in [heading.lower().replace(" ", "-") for heading in headings], link
