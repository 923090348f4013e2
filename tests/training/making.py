"""A small zoo for tests: a suite of two rivals, random linear policies, and a stand-in for training."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import train_zoo as script
import zoo_page

from fpg_bench.common.errors import UserError
from fpg_bench.players.trust import remember_exported
from fpg_bench.products.zoo.zoo import Zoo, ZooAgent, load_zoo
from fpg_bench.training.config import RunConfig
from tests.policies import policy

add_missing_records, page, write_scores = script.add_missing_records, zoo_page.page, zoo_page.write_scores
SUITE = """\
side: ally
scenario: standard
matches: 4
scale: {zero: -5.0, top: 22.0}
rivals:
  - {opponent: adaptive, path: pursuit}
  - {opponent: sweep, path: circle}
"""
ZOO = """\
seeds: [0, 1, 2]
groups:
  small:
    id: FPG/AllyVsScripted-v0
    options: {path: [pursuit, circle]}
    suites: [SUITE]
    steps: {ppo: 2000, td3: 1000}
"""


def make_zoo(folder: Path, more: str = "") -> Zoo:
    """A zoo without agents; ``more`` are suites beside its first."""
    folder.mkdir(exist_ok=True)
    suite = folder / "small-v1.yml"
    suite.write_text(SUITE)
    (folder / "zoo.yml").write_text(ZOO.replace("[SUITE]", f"[{suite}{more}]"))
    return load_zoo(folder)


def make_agent(
    member: ZooAgent, folder: Path | None = None, seed: int | None = None, **other: object
) -> Path:
    """Write an agent folder: the member's own, or another one with something else in ``agent.json``."""
    folder = folder or member.folder
    model = policy(member.seed if seed is None else seed)
    about = {
        "format": 2,
        "algorithm": member.algorithm,
        "id": member.group.id,
        "scenario": "0" * 64,
        "training_seed": member.seed,
        "training_steps": member.steps,
        "seconds": 90.0,
        "policy_sha256": hashlib.sha256(model).hexdigest(),
    }
    about |= other
    about["game"] = {"id": about.pop("id")}
    folder.mkdir(parents=True)
    (folder / "policy.onnx").write_bytes(model)
    (folder / "agent.json").write_text(json.dumps(about))
    remember_exported(about["policy_sha256"])
    return folder


def evaluations(count: int = 5, score: float = 0.0, pace: float = 2.0) -> str:
    """The ``evaluations.jsonl`` of a run."""
    rows = [
        {"side": "ally", "steps": 500 * i, "seconds": pace * i, "score": score + 10 * i} for i in range(count)
    ]
    return "".join(json.dumps(row) + "\n" for row in rows)


def stand_in(here: Path, config: RunConfig, out: Path, **how: object) -> Path:
    """ "Train" a run of the zoo in a folder, unless ``break_<seed>`` there ends it."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "run.json").write_text('{"finished": false}')
    with (here / "begun").open("a") as file:
        file.write(f"{config.seed}\n")
    if (here / f"break_{config.seed}").exists():
        raise UserError("out of luck")
    agents = load_zoo(here).members()
    (agent,) = (a for a in agents if (a.algorithm, a.seed) == (config.algorithm, config.seed))
    if not (out / "agent").exists():
        make_agent(agent, out / "agent")
    (out / "evaluations.jsonl").write_text(evaluations())
    (out / "run.json").write_text('{"finished": true}')
    return out / "agent"
