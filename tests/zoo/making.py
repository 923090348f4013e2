"""A small zoo of its own for tests: a field of two counterparts, and agents with random linear policies."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from fpg_bench.zoo.zoo import Zoo, ZooAgent, load_zoo
from tests.leaderboard.making import policy

FIELD = """\
side: ally
scenario: standard
matches: 4
scale: {zero: -5.0, top: 22.0}
counterparts:
  - {opponent: adaptive, path: pursuit}
  - {opponent: sweep, path: circle}
"""
ZOO = """\
seeds: [0, 1, 2]
views:
  small:
    id: FPG/AllyVsScripted-v0
    options: {path: [pursuit, circle]}
    fields: [FIELD]
    steps: {ppo: 2000, td3: 1000}
"""


def make_zoo(folder: Path, more: str = "") -> Zoo:
    """A zoo without agents; ``more`` are fields beside its first."""
    field = folder / "small-v1.yml"
    field.write_text(FIELD)
    (folder / "zoo.yml").write_text(ZOO.replace("[FIELD]", f"[{field}{more}]"))
    return load_zoo(folder)


def make_agent(
    member: ZooAgent, folder: Path | None = None, seed: int | None = None, **other: object
) -> Path:
    """Write an agent folder: the member's own, or another one with something else in ``agent.json``."""
    folder = folder or member.folder
    model = policy(member.seed if seed is None else seed)
    about = {
        "format": 1,
        "algorithm": member.algorithm,
        "id": member.view.id,
        "scenario": "0",
        "training_seed": member.seed,
        "training_steps": member.steps,
        "seconds": 90.0,
        "policy_sha256": hashlib.sha256(model).hexdigest(),
    }
    folder.mkdir(parents=True)
    (folder / "policy.onnx").write_bytes(model)
    (folder / "agent.json").write_text(json.dumps(about | other))
    return folder


def evaluations(count: int = 5, score: float = 0.0, pace: float = 2.0) -> str:
    """What a run's folder has seen of the score while it trained."""
    rows = [
        {"side": "ally", "steps": 500 * i, "seconds": pace * i, "score": score + 10 * i} for i in range(count)
    ]
    return "".join(json.dumps(row) + "\n" for row in rows)
