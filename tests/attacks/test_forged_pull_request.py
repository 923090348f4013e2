"""A pull request that brings its own verifier is verified by that of the base branch."""

import re
import shutil
import subprocess
import sys

import pytest

from tests.programs import ROOT

pytestmark = [pytest.mark.process, pytest.mark.slow]
ENTRY = "ally/always-hop"


def git(repository, *words):
    identity = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    done = subprocess.run(
        ["git", "-C", str(repository), *identity, *words], check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.fixture
def base(tmp_path):
    """A repository with the script of the workflow, a board without entries, and a package that is ours."""
    top = tmp_path / "repository"
    shutil.copytree(ROOT / ".github", top / ".github")
    (top / "fpg_bench").mkdir()
    (top / "fpg_bench/verifier.sh").write_text(f'exec {sys.executable} -m fpg_bench "$@"\n')
    (top / "leaderboard/submissions/ally").mkdir(parents=True)
    (top / "leaderboard/submissions/ally/.keep").touch()
    program = top / ".venv/bin/fpg-bench"
    program.parent.mkdir(parents=True)
    program.write_text(f"#!/bin/sh\n. {top}/fpg_bench/verifier.sh\n")
    program.chmod(0o755)
    (top / ".gitignore").write_text("/.venv\n")
    git(top, "init", "--quiet", "--initial-branch", "main")
    git(top, "add", "--all")
    git(top, "commit", "--quiet", "--message", "base")
    return top


def verified(top, head):
    """The status and the report of the workflow's script for the merged pull request of this head."""
    done = subprocess.run(
        [str(top / ".github/verify-pull-request"), "merged", head],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


def merge(base):
    """Commit what lies there as the pull request, merge it, and return its head."""
    git(base, "add", "--all")
    git(base, "commit", "--quiet", "--message", "change")
    head = git(base, "rev-parse", "change")
    git(base, "checkout", "--quiet", "-b", "merged", "main")
    git(base, "merge", "--quiet", "--no-ff", "--message", "merge", "change")
    git(base, "checkout", "--quiet", "main")
    return head


def test_a_pull_request_cannot_verify_itself(base):
    git(base, "checkout", "--quiet", "-b", "change")
    shutil.copytree(ROOT / "leaderboard/submissions" / ENTRY, base / "leaderboard/submissions" / ENTRY)
    honest = ROOT / f"leaderboard/results/{ENTRY}.jsonl"
    result = base / f"leaderboard/results/{ENTRY}.jsonl"
    result.parent.mkdir(parents=True)
    result.write_text(re.sub(r'"returns":\[[-\d.]+', '"returns":[999.9', honest.read_text()))
    (base / "fpg_bench/verifier.sh").write_text("echo ally/always-hop: verified: unseen 99.9\n")
    (base / ".github/verify-pull-request").write_text("#!/bin/sh\necho verified: unseen 99.9\n")
    head = merge(base)
    status, report = verified(base, "0" * 40)
    assert status != 0
    assert "has moved on" in report
    status, report = verified(base, head)
    assert status != 0
    assert (
        "outside leaderboard/, not used here:\n  .github/verify-pull-request\n  fpg_bench/verifier.sh"
        in report
    )
    assert "unseen 99.9" not in report
    assert "ally/always-hop: replaced" in report
    assert "commit this one" in report


def test_more_changed_names_than_a_pipe_holds_are_counted(base):
    git(base, "checkout", "--quiet", "-b", "change")
    (base / "docs").mkdir()
    for number in range(800):
        (base / f"docs/{number:03}{'x' * 120}").touch()
    status, report = verified(base, merge(base))
    assert status == 0, report
    assert "  and 780 more\n" in report
    assert "0 verdicts, all good" in report
