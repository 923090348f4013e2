"""The zoo of trained agents: the content of ``zoo.yml``, the shipped agents, and their records."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field as Constraint

from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.entry import Entry, player_entry
from fpg_bench.evaluation.evaluate import LINES, lines_of
from fpg_bench.evaluation.field import Field, load_field
from fpg_bench.evaluation.line import Line
from fpg_bench.files import read_json, read_yaml
from fpg_bench.ids import sides_of
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from fpg_bench.schema import Items, NonNegativeInt, PositiveInt, Strict, parse


class _ViewEntry(Strict):
    """A group of agents in ``zoo.yml``; see :class:`ZooView` for the attributes."""

    id: str
    options: dict[str, Any] = Constraint(default_factory=dict)
    fields: Annotated[Items[str], Constraint(min_length=1)]
    steps: dict[str, PositiveInt]


class _ZooFile(Strict):
    """Content of ``zoo.yml``."""

    seeds: Annotated[Items[NonNegativeInt], Constraint(min_length=1)]
    views: Annotated[dict[str, _ViewEntry], Constraint(min_length=1)]


@dataclass(frozen=True)
class ZooView:
    """A group of agents that are trained on one environment id with the same options.

    Attributes:
        name: name in folders and tables.
        id: the environment id.
        side: the side that its agents play.
        options: options of the games, as in :class:`fpg_bench.training.config.GameOptions`.
        fields: suites that its agents are evaluated on, the public one first.
        steps: training budget of each algorithm.
    """

    name: str
    id: str
    side: str
    options: dict[str, Any]
    fields: tuple[str, ...]
    steps: dict[str, int]


@dataclass(frozen=True)
class ZooAgent:
    """An agent of the zoo, shipped or still to be trained, and its folder."""

    view: ZooView
    algorithm: str
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """Name of the player: ``ally-scripted/ppo/seed_0``."""
        return f"{self.view.name}/{self.algorithm}/seed_{self.seed}"

    @property
    def steps(self) -> int:
        """Training budget."""
        return self.view.steps[self.algorithm]

    @property
    def shipped(self) -> bool:
        """True if the agent is in its folder."""
        return (self.folder / "agent.json").is_file()

    def is_whole(self) -> bool:
        """Return True if the policy is the file that ``agent.json`` describes."""
        policy = self.folder / "policy.onnx"
        digest = hashlib.sha256(policy.read_bytes()).hexdigest() if policy.is_file() else None
        return digest == self.about().get("policy_sha256")

    def about(self) -> dict[str, Any]:
        """Return the content of ``agent.json``; raises UserError where it cannot be read."""
        return read_json(self.folder / "agent.json", "agent")

    def entry(self) -> Entry:
        """Return the shipped agent as an entry of an evaluation; raises UserError where it is damaged."""
        return player_entry(load_agent(self.folder), self.algorithm, self.seed)


@dataclass(frozen=True)
class Zoo:
    """All agents of a folder with ``zoo.yml``, ``agents/`` and ``scores/``."""

    folder: Path
    seeds: tuple[int, ...]
    views: tuple[ZooView, ...]

    def scores(self, view: ZooView) -> Path:
        """Return the folder of a group's records, learning curves and pictures."""
        return self.folder / "scores" / view.name

    def score_file(self, view: ZooView) -> RowFile:
        """Return the file of a group's records, which is only ever appended to."""
        return RowFile(self.scores(view) / LINES)

    def members(self, only: str | None = None) -> list[ZooAgent]:
        """Return the agents, by group, algorithm and seed.

        Args:
            only: ``group``, ``group/algorithm`` or ``group/algorithm/seed_k``; None for all.

        Raises:
            UserError: no agent has this name.
        """
        agents = [
            ZooAgent(view, algorithm, seed, self.folder / "agents" / view.name / algorithm / f"seed_{seed}")
            for view in self.views
            for algorithm in view.steps
            for seed in self.seeds
        ]
        if only is None:
            return agents
        named = [agent for agent in agents if f"{agent.name}/".startswith(f"{only.rstrip('/')}/")]
        if not named:
            known = {"/".join(agent.name.split("/")[:2]) for agent in agents}
            raise UserError(f"the zoo has no {only!r}{nearest(only, known | {v.name for v in self.views})}")
        return named

    def read_lines(self, view: ZooView, field: Field) -> list[Line]:
        """Return the newest records of a group on a suite, those of the present agents and scripts only."""
        prints = {(name, None): name[:16] for name in SCRIPTED[view.side]} | {
            (agent.algorithm, agent.seed): str(agent.about().get("policy_sha256"))[:16]
            for agent in self.members(view.name)
            if agent.shipped
        }
        lines = {}
        for line in lines_of(self.score_file(view)):
            player = (line.entry, line.training_seed)
            if line.field_hash == field.hash[:16] and line.fingerprint == prints.get(player):
                lines[*player, line.counterpart] = line
        return list(lines.values())


def load_zoo(folder: Path | None = None) -> Zoo:
    """Load the zoo of a folder, or the shipped one.

    Raises:
        UserError: no ``zoo.yml`` there, or one with a missing, unknown or invalid key.
    """
    folder = folder or baselines_folder()
    path = folder / "zoo.yml"
    content = parse(_ZooFile, read_yaml(path, "zoo"), f"zoo {path}")
    views = []
    for name, entry in content.views.items():
        sides = sides_of(entry.id)
        side = sides[0] if len(sides) == 1 else load_field(entry.fields[0]).side
        views.append(ZooView(name, entry.id, side, entry.options, entry.fields, entry.steps))
    return Zoo(folder, content.seeds, tuple(views))
