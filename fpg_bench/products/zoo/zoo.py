"""The zoo of trained agents: the content of ``zoo.yml``, the shipped agents, and their records."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field as Constraint

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_json, read_yaml
from fpg_bench.common.ids import ORACLES, SCRIPTED, sides_of
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import Items, NonNegativeInt, PositiveInt, Strict, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.record import Record, read_records
from fpg_bench.evaluation.suite import Suite, read_suite, suite_of
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder, load_agent, read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import SIDES

if TYPE_CHECKING:
    from fpg_bench.evaluation.entry import EvaluatedPlayer

SCORES = "scores/summary.json"  # of a zoo's folder
Players = Mapping[tuple[str, int | None], str]  # fingerprints by name and training seed


class _GroupFile(Strict):
    """A group of agents in ``zoo.yml``; see :class:`ZooGroup` for the attributes."""

    id: str
    options: JsonObject = Constraint(default_factory=dict)
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
        options: options of the games, attributes of :class:`fpg_bench.game.spec.GameSpec`.
        suites: suites that its agents are evaluated on, the public one first.
        steps: training budget of each algorithm.
        hyperparams: file of hyper-parameters of some algorithms; of the others the shipped one.
        note: a remark.
    """

    name: str
    side: str

    @property
    def game(self) -> GameSpec:
        """The game of the training."""
        return GameSpec.from_dict({"id": self.id, **self.options}, f"zoo: {self.name}: options")

    @property
    def training_suite(self) -> str:
        """The suite that scores trainings: the usual one of the game if the group has it, else its first."""
        usual = suite_of(self.game, self.side)
        return usual if usual in self.suites else self.suites[0]


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

    def card(self) -> AgentCard:
        """Return the agent's card; raises UserError where it cannot be read."""
        return read_card(self.folder)

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

    def records_file(self, of: ZooGroup | Suite) -> Path:
        """Return the file of the records of a group's agents, or of the scripts on a suite."""
        if isinstance(of, Suite):
            return self.folder / "scores" / "scripts" / f"{of.name}.jsonl"
        return self.scores(of) / "records.jsonl"

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

    def read_records(self, group: ZooGroup, suite: Suite) -> list[Record]:
        """Return the records of a group and of the scripts on a suite, those of the present players only."""
        agents = self._fingerprints(group)
        own = _read(self.records_file(group), suite, agents)
        return [*self.read_script_records(suite), *self.read_board(group, suite), *own]

    def read_board(self, group: ZooGroup, suite: Suite) -> list[Record]:
        """Return the records of a group's present agents that the board beside the zoo's folder has verified.

        The zoo keeps no copy of them. The entry of an algorithm is called ``group-algorithm`` there.
        """
        agents = self._fingerprints(group)
        results = self.folder.parent / "leaderboard" / "results" / group.side
        return [
            record
            for algorithm in group.steps
            for record in _read(results / f"{group.name}-{algorithm}.jsonl", suite, agents, entry=algorithm)
        ]

    def _fingerprints(self, group: ZooGroup) -> Players:
        """Return the fingerprints of a group's present agents."""
        agents = [agent for agent in self.members(group.name) if agent.shipped]
        return {(agent.algorithm, agent.seed): agent.card().policy_sha256[:16] for agent in agents}

    def read_script_records(self, suite: Suite) -> list[Record]:
        """Return the records of the present scripts and oracles on a suite; empty where there are none."""
        players = _scripts(suite)
        return [*self.read_script_board(suite), *_read(self.records_file(suite), suite, players)]

    def read_script_board(self, suite: Suite) -> list[Record]:
        """Return the records of scripts that the board beside the zoo's folder has; the zoo has no copy."""
        results, players = self.folder.parent / "leaderboard" / "results" / suite.side, _scripts(suite)
        return [
            record
            for name, _ in players
            for table in ("", "-learned", "-link")  # a script may be entered in several
            for record in _read(results / f"{name}{table}.jsonl", suite, players, entry=name)
        ]


def _scripts(suite: Suite) -> Players:
    names = (*SCRIPTED.get(suite.side, ()), *ORACLES)
    return {(name, None): name[:16] for name in names}


def _read(file: Path, suite: Suite, players: Players, **names: str) -> list[Record]:
    """Return the records of players on a suite in a file; names replace those of the board."""
    rows = (row | names for row in RowFile(file).read() if row.get("kind") != "result")
    return [
        record
        for record in read_records(rows, f"records {file}")
        if record.suite_hash == suite.hash[:16]
        and record.fingerprint == players.get((record.entry, record.training_seed))
    ]


def _draws(group: ZooGroup) -> bool:
    """Return True if the agents of a group were trained against several players."""
    return any(isinstance(group.options.get(side), list) for side in SIDES)


def policy_digest(agent: Path) -> str | None:
    """Return the SHA-256 of an agent's policy; None if it has none."""
    policy = agent / "policy.onnx"
    return hashlib.sha256(policy.read_bytes()).hexdigest() if policy.is_file() else None


def read_scores(folder: Path) -> list[Row]:
    """Return the scores of the shipped agents, as they were when the zoo's page was made."""
    file = folder / SCORES
    return list(read_json(file, "zoo")["agents"]) if file.is_file() else []


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
        side = sides[0] if len(sides) == 1 else read_suite(entry.suites[0]).side
        groups.append(ZooGroup(name=name, side=side, **dict(entry)))
    return Zoo(folder, content.seeds, tuple(groups))


def mixture(game: GameSpec) -> GameSpec:
    """Return a game with the rivals and paths that the zoo's agents of its id were trained against.

    Args:
        game: the game; a path that it names is kept and chooses among groups. A scenario without agents
            of its own has the mixture of ``standard``.

    Raises:
        UserError: the zoo has no mixture for this id.
    """
    mixtures = [group for group in load_zoo().groups if _draws(group)]
    groups = [group for group in mixtures if group.id == game.id]
    if not groups:
        known = dict.fromkeys(group.id for group in mixtures)
        raise UserError(f"against zoo: the zoo has no mixture for {game.id}, but for {', '.join(known)}")
    own = [group for group in groups if group.game.scenario == game.scenario]
    groups = own or [group for group in groups if group.game.scenario is None]
    mixed = next((g.game for g in groups if g.game.path == game.path), groups[0].game)
    other = game.config.other_side
    return GameSpec.of(game, **{other: getattr(mixed, other), "path": game.path or mixed.path})
