"""Submissions for tests."""

from __future__ import annotations

import hashlib
from pathlib import Path

import yaml

from fpg_bench.products.leaderboard.submission import Refusal, admit
from fpg_bench.products.sandbox.client import Policy
from tests.policies import write_seed

FIELDS = {
    "name": "Mine",
    "authors": ["A. Author"],
    "algorithm": "linear",
    "reference": None,
    "licence": "MIT",
    "track": "ally",
    "training": {"steps": 1000, "hours": 0.1, "seeds": [0, 1]},
    "saw": "the scripted opponents",
    "unable": "nothing else",
}


def as_policy(data: bytes, seed: int = 0) -> Policy:
    return Policy(seed, None, data, hashlib.sha256(data).hexdigest())


def write_submission(folder: Path, seeds=(0, 1), **changes) -> Path:
    """A sound submission, but for what is changed; a suite that is to be ``...`` is left out."""
    folder.mkdir(parents=True)
    suites = {key: content for key, content in (FIELDS | changes).items() if content is not ...}
    (folder / "submission.yaml").write_text(yaml.safe_dump(suites))
    for seed in seeds:
        write_seed(folder / f"seed_{seed}", seed)
    return folder


def problems(folder: Path) -> list[str]:
    """All problems of a submission's folder."""
    try:
        admit(folder)
    except Refusal as refusal:
        return list(refusal.lines)
    return []
