"""Installation of an agent from the Hub into a folder, after the checks of a submission's policy."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import check_own_folder, check_writable, folder_beside, read_json, write_json
from fpg_bench.common.locks import locked
from fpg_bench.evaluation.suite import load_suite, suite_of
from fpg_bench.products.hub.download import Snapshot
from fpg_bench.products.leaderboard.playing import smoke_test
from fpg_bench.products.leaderboard.submission import read_policy
from fpg_bench.products.sandbox.client import AGENT_FILES, Policy, check_policy

PULLED = "hub.json"  # in the folder of a pulled agent: where it comes from


def keep(snapshot: Snapshot, out: Path) -> bool:
    """Copy a downloaded agent into a folder, with its origin in ``hub.json``.

    The policy is checked as those of submissions are: its files, hash, contents and cost, and a few rounds
    in a sandbox. The folder is there as a whole, or not at all.

    Args:
        snapshot: the downloaded agent.
        out: the folder: new, empty, or with this very agent.

    Returns:
        False if the folder holds this commit already; nothing is done then.

    Raises:
        UserError: the folder holds something else, another commit of this revision for instance, or the
            policy fails a check.
        OSError: a file cannot be read or written.
    """
    check_writable(out)
    with locked(out):
        check_own_folder(out, PULLED, "agent of the Hub")
        origin = {key: getattr(snapshot, key) for key in ("repository", "revision", "commit")}
        if (out / PULLED).exists():
            _check_same(out, origin)
            return False
        with folder_beside(out.absolute()) as temporary:
            agent = temporary / "agent"
            copy_checked(snapshot.folder, agent, snapshot.name)
            write_json(agent / PULLED, origin)
            os.replace(agent, out)
        return True


def copy_checked(source: Path, into: Path, name: str) -> None:
    """Copy the two files of an agent into a new folder, and check them in the same way as a submission.

    Args:
        source: the agent's folder.
        into: the new folder.
        name: name of the agent; begins messages.

    Raises:
        UserError: the first problem of the agent.
        OSError: a file cannot be read or written.
    """
    into.mkdir()
    for file in AGENT_FILES:
        shutil.copyfile(source / file, into / file)
    policy, lines = read_policy(into, None, None)
    lines = [line.lstrip("/") for line in lines]
    if policy is not None and not lines:
        lines = [f"policy.onnx: {line}" for line in check_policy(policy.model) or _play(policy)]
    if lines:
        raise UserError(f"{name}: {lines[0]}")


def _play(policy: Policy) -> list[str]:
    assert policy.card is not None
    return smoke_test(policy, load_suite(suite_of(policy.card.game, policy.card.side)))


def _check_same(out: Path, origin: dict[str, str]) -> None:
    known = read_json(out / PULLED, "agent")
    if known == origin:
        return
    where = f"{known.get('repository')} at {known.get('revision')}, commit {known.get('commit')}"
    if all(known.get(key) == origin[key] for key in ("repository", "revision")):
        where += f", and {origin['revision']} has moved to commit {origin['commit']}"
    raise other_content(out, where)
