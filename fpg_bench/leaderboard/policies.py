"""The policies of a submission: an agent folder per training seed, read as data."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import is_whole
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.leaderboard.folder import file_problem, folder_problem, names, shown, strays
from fpg_bench.leaderboard.onnx_contract import MOST_BYTES, check_policies
from fpg_bench.leaderboard.submission_file import MOST_STEPS
from fpg_bench.players.agent import check_about

MOST_TEXT_BYTES = 64_000
SEED = re.compile(r"seed_(0|[1-9]\d{0,5})")
_FILES = ("agent.json", "policy.onnx")


@dataclass(frozen=True)
class Policy:
    """One training seed's policy, as data: ``about`` is ``agent.json``, ``model`` is ``policy.onnx``."""

    seed: int
    about: dict[str, Any]
    model: bytes
    sha256: str

    @property
    def described(self) -> bool:
        """Whether it is the file that ``agent.json`` tells of, where that can be read."""
        return not self.about or bool(self.about.get("policy_sha256") == self.sha256)

    @property
    def steps(self) -> int | None:
        """The steps that it was trained for, None where ``agent.json`` does not say."""
        steps = self.about.get("training_steps")
        return steps if _is_steps(steps) else None


def seed_folders(folder: Path) -> dict[int, Path]:
    """The folders ``seed_<k>`` in a folder, by training seed."""
    found = {int(match[1]): folder / name for name in names(folder) if (match := SEED.fullmatch(name))}
    return dict(sorted(found.items()))


def read_policies(
    folder: Path, side: str | None, contract: bool = True
) -> tuple[tuple[Policy, ...], list[str]]:
    """The policies of a folder by training seed, and one line per thing that is wrong with them.

    Args:
        folder: holds ``seed_<k>``, each with ``agent.json`` and ``policy.onnx``.
        side: the side that they must play; None: either.
        contract: whether to check what the policies hold, too, which takes a process.
    """
    policies: list[Policy] = []
    found: list[str] = []
    for seed, path in seed_folders(folder).items():
        policy, wrong = _read(path, seed, side)
        found += [f"{path.name}{record}" for record in wrong]
        same = [other.seed for other in policies if policy and other.sha256 == policy.sha256]
        if same:
            found.append(
                f"{path.name}: holds the same policy as seed_{same[0]}; a seed is a training of its own"
            )
        policies += [policy] if policy else []
    whole = [policy for policy in policies if policy.described] if contract else []
    for policy, wrong in zip(whole, check_policies([policy.model for policy in whole]), strict=True):
        found += [f"seed_{policy.seed}/policy.onnx: {record}" for record in wrong]
    return tuple(policies), found


def _read(path: Path, seed: int, side: str | None) -> tuple[Policy | None, list[str]]:
    """One seed's policy, and what is wrong with its folder."""
    if problem := folder_problem(path):
        return None, [f": {problem}"]
    found = [f"/{record}" for record in strays(path, _FILES)]
    for name, most in zip(_FILES, (MOST_TEXT_BYTES, MOST_BYTES), strict=True):
        if problem := file_problem(path / name, most):
            found.append(f"/{name}: {problem}")
    if any(record.startswith(tuple(f"/{name}:" for name in _FILES)) for record in found):
        return None, found
    about, wrong = _about(path / "agent.json", seed, side)
    model = (path / "policy.onnx").read_bytes()
    policy = Policy(seed, about, model, hashlib.sha256(model).hexdigest())
    if not policy.described:
        wrong.append(
            "policy_sha256: is not that of policy.onnx beside it, which was cut off or changed since"
        )
    found += [f"/agent.json: {record}" for record in wrong]
    return policy, found


def _about(path: Path, seed: int, side: str | None) -> tuple[dict[str, Any], list[str]]:
    """What ``agent.json`` says, and what is wrong with it."""
    try:
        about = read_json(path, "agent")
        check_about(about, "agent", side)
    except UserError as error:
        return {}, [
            str(error).replace(f"agent {path}: ", "").removeprefix("agent: ").replace("agent.json ", "")
        ]
    found = []
    if about["training_seed"] != seed or isinstance(about["training_seed"], bool):
        found.append(
            f"training_seed: expected {seed}, as the folder is called, got {shown(about['training_seed'])}"
        )
    if not _is_steps(about["training_steps"]):
        steps = shown(about["training_steps"])
        found.append(f"training_steps: expected a whole number from 0 to {MOST_STEPS:,}, got {steps}")
    if not isinstance(about["algorithm"], str) or len(about["algorithm"]) > 60:
        found.append(f"algorithm: expected text of at most 60 characters, got {shown(about['algorithm'])}")
    if not _finite(about):
        found.append("holds a number that is not finite")
    return about, found


def _is_steps(value: Any) -> bool:
    """Whether a number of training steps is one."""
    return is_whole(value, 0) and value <= MOST_STEPS


def _finite(value: Any) -> bool:
    """Whether all numbers in what was read from JSON are finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    return all(map(_finite, value)) if isinstance(value, list) else True
