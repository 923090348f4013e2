"""What the page on clusters says is so."""

import re
import subprocess
from pathlib import Path

import pytest

from fpg_bench.cli import app
from tests.programs import python

TEXT = (Path(__file__).parents[2] / "docs" / "cluster.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)


def options(verb):
    (found,) = [c for c in app.registered_commands if c.callback.__name__ == verb]
    return {f"--{name.replace('_', '-')}" for name in found.callback.__annotations__}


def test_every_command_has_its_options():
    code = "\n".join(code for language, code in BLOCKS if language == "bash").replace("\\\n", " ")
    commands = [
        line.split("fpg-bench ")[1].split() for line in code.splitlines() if "  fpg-bench " in f"  {line}"
    ]
    assert {words[0] for words in commands} == {"train", "tune", "evaluate"}
    for verb, *words in commands:
        assert {word for word in words if word.startswith("--")} <= options(verb)


def test_scripts_for_the_shell_are_some():
    for language, code in BLOCKS:
        if language == "bash":
            subprocess.run(["bash", "-n"], input=code, text=True, check=True)


@pytest.mark.process
def test_a_list_of_ones_own_is_run_once(tmp_path):
    code = [code for language, code in BLOCKS if language == "python"][-1]
    for said in (["idle: begins", "expert: begins"], []):
        found = python("-c", code, folder=tmp_path)
        assert found.returncode == 0, found.stderr
        assert [line for line in found.stdout.splitlines() if "begins" in line] == said
    assert len((tmp_path / "records.jsonl").read_text().splitlines()) == 2
