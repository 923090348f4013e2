"""The zoo as data: which agents there are to be, and where each of them lies."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.checks import check_keys, is_whole, mapping
from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.field import load_field
from fpg_bench.files import read_json, read_yaml
from fpg_bench.ids import sides_of
from fpg_bench.players.agent import baselines_folder

_KEYS = {"seeds", "views"}
_VIEW_KEYS = {"id", "options", "fields", "steps"}


@dataclass(frozen=True)
class ZooView:
    """One view of the game that agents are trained on.

    Attributes:
        name: what folders and tables call it.
        id: the environment id.
        options: what it is made with, as :class:`fpg_bench.envs.core.OneSided` takes it.
        fields: those that its agents are measured against, the public one first.
        steps: the training budget of each algorithm.
    """

    name: str
    id: str
    options: dict[str, Any]
    fields: tuple[str, ...]
    steps: dict[str, int]

    @property
    def side(self) -> str:
        """The side that its agents play."""
        return load_field(self.fields[0]).side


@dataclass(frozen=True)
class ZooAgent:
    """One agent of the zoo, shipped or still to be trained; ``folder`` is where it lies once it is."""

    view: ZooView
    algorithm: str
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """What players call it: ``ally-scripted/ppo/seed_0``."""
        return f"{self.view.name}/{self.algorithm}/seed_{self.seed}"

    @property
    def steps(self) -> int:
        """Its training budget."""
        return self.view.steps[self.algorithm]

    @property
    def shipped(self) -> bool:
        """Whether it is there."""
        return (self.folder / "agent.json").is_file()

    def is_whole(self) -> bool:
        """Whether its policy is the file that ``agent.json`` describes."""
        policy = self.folder / "policy.onnx"
        found = hashlib.sha256(policy.read_bytes()).hexdigest() if policy.is_file() else None
        return found == self.about().get("policy_sha256")

    def about(self) -> dict[str, Any]:
        """What its ``agent.json`` says; raises UserError where that cannot be read."""
        return read_json(self.folder / "agent.json", "agent")


@dataclass(frozen=True)
class Zoo:
    """All agents of a folder with a ``zoo.yml``: ``agents/``, ``scores/`` and the ``README.md`` beside it."""

    folder: Path
    seeds: tuple[int, ...]
    views: tuple[ZooView, ...]

    def scores(self, view: ZooView) -> Path:
        """The folder of a view's scores, learning curves and pictures."""
        return self.folder / "scores" / view.name

    def members(self, only: str | None = None) -> list[ZooAgent]:
        """The agents, by view, algorithm and seed.

        Args:
            only: ``view``, ``view/algorithm`` or ``view/algorithm/seed_k``; None: all.

        Raises:
            UserError: none is called so.
        """
        every = [
            ZooAgent(view, algorithm, seed, self.folder / "agents" / view.name / algorithm / f"seed_{seed}")
            for view in self.views
            for algorithm in view.steps
            for seed in self.seeds
        ]
        found = [m for m in every if only is None or f"{m.name}/".startswith(f"{only.rstrip('/')}/")]
        if not found:
            known = {"/".join(m.name.split("/")[:2]) for m in every} | {view.name for view in self.views}
            raise UserError(f"the zoo has no {only!r}{nearest(str(only), known)}")
        return found


def load_zoo(folder: Path | None = None) -> Zoo:
    """The zoo of a folder, or the shipped one.

    Raises:
        UserError: no ``zoo.yml`` there, or one with a missing, unknown or ill-formed key.
    """
    folder = folder or baselines_folder()
    path = folder / "zoo.yml"
    content = read_yaml(path, "zoo")
    check_keys(content, _KEYS, f"zoo {path}", sorted(_KEYS))
    seeds, views = content["seeds"], content["views"]
    if not isinstance(seeds, list) or not seeds or not all(is_whole(seed, 0) for seed in seeds):
        raise UserError(f"zoo {path}: seeds: expected a list of whole numbers, got {seeds!r}")
    if not isinstance(views, dict) or not views:
        raise UserError(f"zoo {path}: views: expected a mapping, got {views!r}")
    return Zoo(folder, tuple(seeds), tuple(_view(name, item, path) for name, item in views.items()))


def _view(name: str, content: Any, path: Path) -> ZooView:
    where = f"zoo {path}: {name}"
    content = {"options": {}, **content} if isinstance(content, dict) else content
    check_keys(content, _VIEW_KEYS, where, sorted(_VIEW_KEYS))
    steps, options = content["steps"], content["options"]
    mapping(options, f"{where}: options")
    if not isinstance(steps, dict) or not all(is_whole(budget) for budget in steps.values()):
        raise UserError(f"{where}: steps: expected algorithm: steps, got {steps!r}")
    fields = content["fields"]
    if not isinstance(fields, list) or not fields:
        raise UserError(f"{where}: fields: expected a list of fields' names, got {fields!r}")
    sides_of(content["id"])
    return ZooView(str(name), content["id"], options, tuple(map(str, fields)), steps)
