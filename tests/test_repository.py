"""The repository's habits: what its workflows may do, and what they call."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.programs import ROOT

WORKFLOWS = {
    path.stem: yaml.safe_load(path.read_text()) for path in (ROOT / ".github/workflows").glob("*.yml")
}
RIGHTS = {  # what each may write; everything else it can at most read
    "tests": set(),
    "docs": {"pages", "id-token"},
    "release": {"id-token"},
    "board-verify": {"pull-requests"},
}


def steps(workflow):
    return [step for job in WORKFLOWS[workflow]["jobs"].values() for step in job["steps"]]


@pytest.mark.parametrize("name", RIGHTS)
def test_a_workflow_has_few_rights_no_password_no_moving_action_and_no_foreign_text_in_a_command(name):
    rights = [WORKFLOWS[name]["permissions"]]
    rights += [job["permissions"] for job in WORKFLOWS[name]["jobs"].values() if "permissions" in job]
    assert {right for each in rights for right, kind in each.items() if kind == "write"} == RIGHTS[name]
    assert "secrets." not in (ROOT / f".github/workflows/{name}.yml").read_text()
    for step in steps(name):
        if "uses" in step:
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", step["uses"])
        if str(step.get("uses", "")).startswith("actions/checkout"):
            assert step["with"]["persist-credentials"] is False
        assert "${{" not in step.get("run", "")  # what a stranger wrote is handed over as a variable
        assert "${{" not in step.get("with", {}).get("script", "")


def test_only_the_board_is_verified_by_the_base_branch_and_it_runs_no_code_of_the_pull_request():
    assert WORKFLOWS.keys() == RIGHTS.keys()
    triggered = [name for name in RIGHTS if "pull_request_target" in WORKFLOWS[name][True]]  # YAML's "on"
    assert triggered == ["board-verify"]
    verify, comment = (WORKFLOWS["board-verify"]["jobs"][job] for job in ("verify", "comment"))
    assert "permissions" not in verify  # those of the workflow: read
    assert "ref" not in verify["steps"][0]["with"]  # the base branch
    assert [step["uses"].split("@")[0] for step in comment["steps"]] == [
        "actions/download-artifact",
        "actions/github-script",
    ]


@pytest.mark.parametrize("name", RIGHTS)
def test_workflows_call_what_there_is(name):
    makefile = (ROOT / "Makefile").read_text()
    commands = "\n".join(step.get("run", "") for step in steps(name))
    for target in re.findall(r"make ([\w-]+)", commands):
        assert f"\n{target}:" in makefile
    for file in re.findall(r"(?:\./)?(\.ci/\w+|\.github/[\w-]+|tests/\w+\.py)", commands):
        assert (ROOT / file).exists(), file


def test_no_address_is_told_of_a_host_that_does_not_exist():
    assert "[project.urls]" not in (ROOT / "pyproject.toml").read_text()
    made_up = re.compile(r"github\.com/fpg-bench|fpg-bench\.(org|io|readthedocs)")
    kept = [path for name in ("fpg_bench", "docs", ".github") for path in (ROOT / name).rglob("*")]
    kept += [ROOT / name for name in ("README.md", "CITATION.cff", "pyproject.toml", "CONTRIBUTING.md")]
    for path in kept:
        if path.suffix in (".py", ".md", ".html", ".yml", ".toml", ".cff", ".js", ".j2"):
            assert not made_up.search(path.read_text()), path


def test_the_container_installs_the_tested_versions_for_a_plain_user_and_runs_the_benchmark():
    """Parsed only: building it needs Docker, which the workflow `tests` has."""
    text = re.sub(r"\\\n", " ", (ROOT / "Dockerfile").read_text())
    steps = [line.split(maxsplit=1) for line in text.splitlines() if line and not line.startswith("#")]
    kinds = [kind for kind, _ in steps]
    assert steps[0] == ["FROM", "python:3.11-slim"]
    installed = [part for _, words in steps for part in words.split("&&") if "pip install" in part]
    assert len(installed) == 2
    assert all("-c constraints.txt" in part for part in installed)
    assert "pip install" not in " ".join(words for _, words in steps[kinds.index("USER") :])
    assert dict(steps)["USER"] not in ("root", "0")
    program, option, command = json.loads(dict(steps)["CMD"])
    assert (program, option) == ("sh", "-c")
    make = (ROOT / "Makefile").read_text().replace("$(STEPS)", "2000000").replace("$(RESULTS)", "results")
    assert [line for line in command.split(" && ") if f"$(BIN)/{line}\n" not in make] == []


def test_the_container_gets_what_the_wheel_is_made_of():
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    text = (ROOT / "Dockerfile").read_text()
    copied = {name for words in re.findall(r"(?m)^COPY (.*) \S+$", text) for name in words.split()}
    assert copied == kept
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {Path(name).parts[0] for name in (*build["packages"], *build["force-include"], "pyproject.toml")}
    assert needed <= copied
    assert all((ROOT / name).exists() for name in copied)
