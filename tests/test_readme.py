"""Everything in the README is run: its Python, its commands (with small budgets), its links."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)


def small(text):
    """The same words with budgets that a test can bear."""
    return re.sub(r"(--steps |total_timesteps=)[\d_]+", r"\g<1>20000", text)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("readme")
    (folder / "bin").mkdir()
    fpg_bench = folder / "bin" / "fpg-bench"
    fpg_bench.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m fpg_bench.cli "$@"\n')
    fpg_bench.chmod(0o755)
    return folder


def test_every_block_works_in_the_order_of_the_page(folder):
    environment = os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}
    ran = []
    for language, code in BLOCKS:
        if language == "yaml":
            (folder / code.splitlines()[0].removeprefix("# ")).write_text(code)
            continue
        if "class Blocker" in code:
            (folder / "mine.py").write_text(code)
        for command in [code] if language == "python" else code.strip().splitlines():
            if command.startswith("make "):
                continue  # test_make_targets
            words = (
                [sys.executable, "-c", small(command)]
                if language == "python"
                else ["sh", "-c", small(command)]
            )
            found = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
            assert found.returncode == 0, f"{command}\n{found.stderr}"
            ran.append(command)
    assert len(ran) >= 10


def test_make_targets():
    for target in ("benchmark", "test"):
        assert f"make {target}" in TEXT
        assert subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True).returncode == 0


def test_links_lead_somewhere():
    for link in re.findall(r"\]\(([^)]+)\)", TEXT):
        file, _, anchor = link.partition("#")
        assert (ROOT / file).exists(), link
        headings = re.findall(r"^#+ (.+)$", (ROOT / file).read_text(), re.MULTILINE) if anchor else []
        assert not anchor or anchor in [heading.lower().replace(" ", "-") for heading in headings], link
