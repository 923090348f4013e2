"""The zoo of trained agents: the content of ``zoo.yml``, the shipped agents, and their records."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field as Constraint

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_json, read_yaml
from fpg_bench.common.ids import SCRIPTED, sides_of
from fpg_bench.common.rows import RowFile
from fpg_bench.common.schema import Items, NonNegativeInt, PositiveInt, Strict, parse
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.suite import Suite, load_suite
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.players.player import SIDES

if TYPE_CHECKING:
    from fpg_bench.evaluation.entry import EvaluatedPlayer


class _GroupFile(Strict):
    """A group of agents in ``zoo.yml``; see :class:`ZooGroup` for the attributes."""

    id: str
    options: dict[str, Any] = Constraint(default_factory=dict)
    suites: Annotated[Items[str], Constraint(min_length=1)]
    steps: dict[str, PositiveInt]
    hyperparams: dict[str, str] = Constraint(default_factory=dict)
    note: str = ""


class _ZooFile(Strict):
    """Content of ``zoo.yml``."""

    seeds: Annotated[Items[NonNegativeInt], Constraint(min_length=1)]
    groups: Annotated[dict[str, _GroupFile], Constraint(min_length=1)]


class ZooGroup(_GroupFile):
    """A group of agents that are trained on one environment id with the same options.

    Attributes:
        name: name in folders and tables.
        id: the environment id.
        side: the side that its agents play.
        options: options of the games, as in :class:`fpg_bench.training.config.GameOptions`.
        suites: suites that its agents are evaluated on, the public one first.
        steps: training budget of each algorithm.
        hyperparams: file of hyper-parameters of some algorithms; of the others the shipped one.
        note: a remark for the zoo's page.
    """

    name: str
    side: str


@dataclass(frozen=True)
class ZooAgent:
    """An agent of the zoo, shipped or still to be trained, and its folder."""

    group: ZooGroup
    algorithm: str
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """Name of the player: ``ally-scripted/ppo/seed_0``."""
        return f"{self.group.name}/{self.algorithm}/seed_{self.seed}"

    @property
    def steps(self) -> int:
        """Training budget."""
        return self.group.steps[self.algorithm]

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

    def entry(self) -> EvaluatedPlayer:
        """Return the shipped agent as an entry of an evaluation; raises UserError where it is damaged."""
        from fpg_bench.evaluation.entry import player_entry  # needs the extra `evaluate`

        return player_entry(load_agent(self.folder), self.algorithm, self.seed)


@dataclass(frozen=True)
class Zoo:
    """All agents of a folder with ``zoo.yml``, ``agents/`` and ``scores/``."""

    folder: Path
    seeds: tuple[int, ...]
    groups: tuple[ZooGroup, ...]

    def scores(self, group: ZooGroup) -> Path:
        """Return the folder of a group's records, learning curves and pictures."""
        return self.folder / "scores" / group.name

    def score_file(self, group: ZooGroup) -> RowFile:
        """Return the file of a group's records, which is only ever appended to."""
        return RowFile(self.scores(group) / "records.jsonl")

    def members(self, only: str | None = None) -> list[ZooAgent]:
        """Return the agents, by group, algorithm and seed.

        Args:
            only: ``group``, ``group/algorithm`` or ``group/algorithm/seed_k``; None for all.

        Raises:
            UserError: no agent has this name.
        """
        agents = [
            ZooAgent(group, algorithm, seed, self.folder / "agents" / group.name / algorithm / f"seed_{seed}")
            for group in self.groups
            for algorithm in group.steps
            for seed in self.seeds
        ]
        if only is None:
            return agents
        named = [agent for agent in agents if f"{agent.name}/".startswith(f"{only.rstrip('/')}/")]
        if not named:
            known = {group.name for group in self.groups}
            known |= {"/".join(agent.name.split("/")[:2]) for agent in agents}
            raise UserError(f"the zoo has no {only!r}{nearest(only, known)}")
        return named

    def mixture(
        self, env_id: str, path: str | Sequence[str] | None = None, scenario: object = None
    ) -> dict[str, Any]:
        """Return the rivals and paths that the zoo's agents of an environment were trained against.

        Args:
            env_id: the environment id.
            path: flight path of the opponent; None for that of the id's first group.
            scenario: name of the scenario; for one without agents of its own, the mixture of ``standard``.

        Returns:
            Options of the games, with ``path`` replaced by the one that is given.

        Raises:
            UserError: the zoo has no mixture for this environment.
        """
        groups = [group for group in self.groups if group.id == env_id and _draws(group)]
        if not groups:
            known = dict.fromkeys(group.id for group in self.groups if _draws(group))
            raise UserError(f"against zoo: the zoo has no mixture for {env_id}, but for {', '.join(known)}")
        own = [group for group in groups if group.options.get("scenario") == scenario]
        groups = own or [group for group in groups if "scenario" not in group.options]
        options = next((g.options for g in groups if g.options.get("path") == path), groups[0].options)
        options = {key: value for key, value in options.items() if key not in ("scenario", "actions")}
        return options if path is None else {**options, "path": path}

    def read_records(self, group: ZooGroup, suite: Suite) -> list[Record]:
        """Return the newest records of a group on a suite, those of the present agents and scripts only."""
        from fpg_bench.evaluation.evaluate import records_of  # needs the extra `evaluate`

        prints: dict[tuple[str, int | None], str] = {(name, None): name[:16] for name in SCRIPTED[group.side]}
        prints |= {
            (agent.algorithm, agent.seed): str(agent.about().get("policy_sha256"))[:16]
            for agent in self.members(group.name)
            if agent.shipped
        }
        records = {}
        for record in records_of(self.score_file(group)):
            player = (record.entry, record.training_seed)
            if record.suite_hash == suite.hash[:16] and record.fingerprint == prints.get(player):
                records[*player, record.rival] = record
        return list(records.values())


def _draws(group: ZooGroup) -> bool:
    """Return True if the agents of a group were trained against several players."""
    return any(isinstance(group.options.get(side), list) for side in SIDES)


def load_zoo(folder: Path | None = None) -> Zoo:
    """Load the zoo of a folder, or the shipped one.

    Raises:
        UserError: no ``zoo.yml`` there, or one with a missing, unknown or invalid key.
    """
    folder = folder or baselines_folder()
    path = folder / "zoo.yml"
    content = parse(_ZooFile, read_yaml(path, "zoo"), f"zoo {path}")
    groups = []
    for name, entry in content.groups.items():
        sides = sides_of(entry.id)
        side = sides[0] if len(sides) == 1 else load_suite(entry.suites[0]).side
        groups.append(ZooGroup(name=name, side=side, **dict(entry)))
    return Zoo(folder, content.seeds, tuple(groups))
