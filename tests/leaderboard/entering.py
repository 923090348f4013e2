"""Small boards for tests: submissions on panels of two entries, and policies that misbehave."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from fpg_bench.evaluation.references import measure_panel

from fpg_bench.leaderboard.host import PolicyFailed
from fpg_bench.players.agent import OnnxPlayer
from tests.evaluation.zoo_making import PANEL, policy

OTHER_PANEL = """\
side: opponent
scenario: standard
rounds: 4
reference: adaptive
entries:
  - {ally: idle, path: PATH}
  - {ally: expert, path: PATH}
"""


def make_panels(folder: Path) -> dict[tuple[str, str | None], str]:
    """Small panels of both sides, measured, in place of those of the tracks."""
    found: dict[tuple[str, str | None], str] = {}
    for track, path in (("ally", None), ("opponent", "pursuit"), ("opponent", "learned")):
        file = folder / f"{track}-{path}.yml"
        file.write_text(PANEL if path is None else OTHER_PANEL.replace("PATH", path))
        measure_panel(str(file), 20)
        found[track, path] = str(file)
    return found


def enter(board: Path, track: str, slug: str, **other: Any) -> Path:
    """Write a submission of a script, or of linear policies where ``seeds`` says which."""
    folder = board / "submissions" / track / slug
    folder.mkdir(parents=True)
    seeds = other.pop("seeds", ())
    about = {
        "name": slug.title(),
        "authors": ["Someone"],
        "algorithm": "none",
        "reference": None,
        "licence": "MIT",
        "track": track,
        "training": {"steps": 10, "hours": 0.1, "seeds": list(seeds)} if seeds else None,
        "saw": "nothing",
        "unable": "much",
    }
    if track == "opponent":
        about["path"] = "pursuit"
    (folder / "submission.yaml").write_text(yaml.safe_dump(about | other))
    for seed in seeds:
        _agent(folder / f"seed_{seed}", track, seed)
    return folder


def _agent(folder: Path, side: str, seed: int) -> None:
    model = policy(seed)
    about = {
        "format": 1,
        "algorithm": "none",
        "id": "FPG/AllyVsScripted-v0" if side == "ally" else "FPG/OpponentVsScripted-v0",
        "scenario": "0",
        "training_seed": seed,
        "training_steps": 10,
        "policy_sha256": hashlib.sha256(model).hexdigest(),
    }
    folder.mkdir()
    (folder / "policy.onnx").write_bytes(model)
    (folder / "agent.json").write_text(json.dumps(about))


class InProcess:
    """A PolicyHost that starts no process; ``loses`` games' rounds, and fails at once where ``fails``."""

    loses: tuple[int, ...] = ()
    fails = False
    started = 0

    def __init__(self, policy: Any, limits: Any = None, again: float | None = None) -> None:
        type(self).started += 1
        self._player = OnnxPlayer(policy.model, policy.about)
        self.invalid = np.zeros(0, bool)

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        self._player.reset(mask, seeds)
        self.invalid = np.isin(np.arange(len(mask)), self.loses)

    def predict(self, *seen: Any) -> Any:
        if self.fails:
            raise PolicyFailed("took longer than it may")
        actions, memory = self._player.predict(*seen)
        actions = np.where(self.invalid[:, None], np.float32(0), actions)
        return actions, memory
