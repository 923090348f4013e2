"""The repository's habits: what its workflows may do, and what they call."""

import re

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
    "board-verify": set(),
    "board-comment": {"pull-requests"},
}


def steps(workflow):
    return [step for job in WORKFLOWS[workflow]["jobs"].values() for step in job["steps"]]


def test_each_workflow_is_known():
    assert WORKFLOWS.keys() == RIGHTS.keys()


@pytest.mark.parametrize("name", RIGHTS)
def test_a_workflow_writes_what_it_must_and_nothing_else(name):
    told = [WORKFLOWS[name]["permissions"]]
    told += [job["permissions"] for job in WORKFLOWS[name]["jobs"].values() if "permissions" in job]
    assert {right for rights in told for right, kind in rights.items() if kind == "write"} == RIGHTS[name]


@pytest.mark.parametrize("name", RIGHTS)
def test_no_stored_password_and_no_code_of_a_pull_request_with_rights(name):
    text = (ROOT / f".github/workflows/{name}.yml").read_text()
    assert "secrets." not in text
    assert "pull_request_target" not in text
    for step in steps(name):
        if str(step.get("uses", "")).startswith("actions/checkout"):
            assert step["with"]["persist-credentials"] is False
        assert "${{" not in step.get("run", "")  # what a stranger wrote is handed over as a variable


def test_whoever_comments_checks_nothing_out_and_runs_nothing():
    assert [step["uses"].split("@")[0] for step in steps("board-comment")] == [
        "actions/download-artifact",
        "actions/github-script",
    ]
    assert "github.event" not in steps("board-comment")[1]["with"]["script"]


@pytest.mark.parametrize("name", RIGHTS)
def test_workflows_call_what_there_is(name):
    makefile = (ROOT / "Makefile").read_text()
    commands = "\n".join(step.get("run", "") for step in steps(name))
    for target in re.findall(r"make ([\w-]+)", commands):
        assert f"\n{target}:" in makefile
    for file in re.findall(r"(?:\./)?(\.ci/\w+|tests/\w+\.py)", commands):
        assert (ROOT / file).exists(), file


def test_addresses_stand_in_one_place():
    """There is none yet, so none is told: not of a host that does not exist."""
    project = (ROOT / "pyproject.toml").read_text()
    assert "[project.urls]" not in project
    made_up = re.compile(r"github\.com/fpg-bench|fpg-bench\.(org|io|readthedocs)")
    kept = [path for name in ("fpg_bench", "docs", ".github") for path in (ROOT / name).rglob("*")]
    kept += [ROOT / name for name in ("README.md", "CITATION.cff", "pyproject.toml", "CONTRIBUTING.md")]
    for path in kept:
        if path.suffix in (".py", ".md", ".html", ".yml", ".toml", ".cff", ".js", ".j2"):
            assert not made_up.search(path.read_text()), path
