"""Configuration of a training run."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.common.checks import check_keys
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL, ENVS, OFFLINE, find_env, policy_env, sides_of
from fpg_bench.evaluation.suite import suite_of
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.hub import pinned
from fpg_bench.players.player import SIDES, Player
from fpg_bench.training.algorithms import find_algorithm

if TYPE_CHECKING:
    from fpg_bench.datasets.read import Dataset

Players = str | Player | Sequence[str | Player]  # one, or several to draw from per round


@dataclass(frozen=True)
class GameOptions:
    """Options of the games that a run trains in; None leaves the default of the environment id.

    Attributes:
        scenario: a scenario, the name of a preset, or a YAML file.
        opponent, ally: the other side's player, or several; ``suite:NAME`` stands for all members of a suite.
        path: flight path of the opponent, or several to draw one from per round.
        planner: planner of the opponent's path, by name or as an object.
        knowledge: the ally's knowledge base: ``expert``, ``none``, or a YAML file.
        jamming_types: the allowed jamming types.
        reward: reward of the learner; see :func:`fpg_bench.envs.core.compute_reward`.
        actions: action mode: ``continuous``, ``discrete`` or ``multi-discrete``.
        observation: the ally's observation, ``numbers`` or ``waterfall``.
        history: rows of the waterfall.
    """

    scenario: Scenario | str | Path | None = None
    opponent: Players | None = None
    ally: Players | None = None
    path: str | Sequence[str] | None = None
    planner: Any = None
    knowledge: str | None = None
    jamming_types: str | Sequence[str] | None = None
    reward: str | None = None
    actions: str | None = None
    observation: str | None = None
    history: int | None = None

    @classmethod
    def parse(cls, content: Mapping[str, Any], where: str) -> GameOptions:
        """Read the options from a mapping of a YAML or JSON file.

        Raises:
            UserError: not a mapping, or an unknown key; ``where`` begins the message.
        """
        check_keys(content, [each.name for each in dataclasses.fields(cls)], where)
        return cls(**content)

    def to_dict(self) -> dict[str, Any]:
        """Return the options that are set, by name."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class RunConfig:
    """Everything that distinguishes one training run from another, apart from its folder.

    Attributes:
        algorithm: ``ppo``, ``ppo-fast``, ``sac``, ``td3``, ``recurrent-ppo``, ``ppo-stack8`` and the like,
            ``maddpg``, ``package.module:Class``, or a class with Stable-Baselines3's interface.
        env_id: environment id, for instance ``FPG/AllyVsScripted-v0``; ``FPG/duel_v0`` trains both sides.
        seed: training seed k; its games start at game seed k * 10^6.
        steps: budget over all games, rounded up to whole rollouts; None takes that of the hyper-parameters.
        hyperparams: a YAML file, or its entry for the id; None takes the shipped file.
        game: options of the games.
        suite: suite that scores the policy during training, on tuning seeds; None takes that of the id.
        against: the other side's player or players, whichever side that is.
        start: folder of a finished run of the same side, algorithm and networks (for PPO also ``bc``); the
            new run starts from its weights, optimizer and normalization, and skips imitation.
        transcript: transcript of a run with a language model; its plans are replayed without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, and ``server``, the profile of
            the endpoint.
        dataset: data set of an offline algorithm; see :meth:`offline`.
        allow: the ``package.module:object`` and agents of the Hub that the files of the hyper-parameters
            and of the suite may name; neither is run on a file's word.
    """

    algorithm: str | type[BaseAlgorithm]
    env_id: str
    seed: int = 0
    steps: int | None = None
    hyperparams: str | Path | Mapping[str, Any] | None = None
    game: GameOptions = dataclasses.field(default_factory=GameOptions)
    suite: str | None = None
    against: Players | None = None
    start: str | Path | None = None
    transcript: str | Path | None = None
    llm: Mapping[str, Any] | None = None
    dataset: Dataset | None = None
    allow: Collection[str] = ()

    @classmethod
    def offline(cls, algorithm: str, dataset: Dataset, **options: Any) -> RunConfig:
        """Return the configuration of a run that learns from a data set.

        Args:
            algorithm: one of :data:`fpg_bench.common.ids.OFFLINE`, with or without stacked frames.
            dataset: the data set.
            **options: further attributes.

        Raises:
            UserError: an algorithm that does not learn from data sets, or not from this action mode.
        """
        spec, base = dataset.spec, find_algorithm(algorithm).base
        if spec.actions not in OFFLINE.get(base, ()):
            fitting = [name for name, modes in OFFLINE.items() if spec.actions in modes]
            raise UserError(
                f"{algorithm}: does not learn from a data set of {spec.actions} actions, as {spec.name} is; "
                f"these do: {', '.join(fitting)}"
            )
        game = GameOptions(**spec.env_options, actions=spec.actions)
        return cls(algorithm, policy_env(spec.side).id, game=game, dataset=dataset, **options)

    @property
    def id(self) -> str:
        """The plain id, without the action mode."""
        return DUEL if len(self.sides) == 2 else find_env(self.env_id).id

    @property
    def actions(self) -> str:
        """The action mode: the one that is set, else that of the id; raises UserError if they differ."""
        if len(self.sides) == 2:
            return self.game.actions or "continuous"
        return find_env(self.env_id).action_mode(self.game.actions)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides that learn; raises UserError for an unknown id."""
        return sides_of(self.env_id)

    @property
    def planner(self) -> Any:
        """The planner of the opponent's path: the one that is set, else the default of the id."""
        return self.game.planner or (ENVS[self.id].planner if self.id in ENVS else None)

    def game_options(self) -> dict[str, Any]:
        """Return the options that are set, with the players of ``against`` under the name of their side.

        Agents on the Hub are pinned to their commits.

        Raises:
            UserError: both sides learn, or the other side's players are named twice.
        """
        options = self.game.to_dict()
        if self.actions != "continuous":
            options["actions"] = self.actions
        if self.against is None:
            return _pinned(options)
        if self.id == DUEL:
            raise UserError(f"against: in {DUEL} both sides learn; omit it")
        other = find_env(self.id).other_side
        if other in options:
            raise UserError(f"against: names the {other}, and so does {other}; give only one of them")
        return _pinned({**options, other: self.against})

    def suites(self) -> list[str]:
        """Return the suite that scores each side; raises UserError where one suite is set for both sides."""
        if self.suite and len(self.sides) == 2:
            raise UserError(f"suite: each side of {DUEL} is scored on its own suite; omit it")
        options = self.game_options()
        return [self.suite] if self.suite else [suite_of(self.id, options, side) for side in self.sides]

    def options(self) -> dict[str, Any]:
        """Return the command-line options other than algorithm, id, seed, steps, hyperparams and suite."""
        llm = {name.removesuffix("_s"): value for name, value in (self.llm or {}).items()}
        options = {**self.game_options(), "transcript": self.transcript, "start": self.start, **llm}
        return {name: value for name, value in options.items() if value is not None}


def _pinned(options: dict[str, Any]) -> dict[str, Any]:
    """Return game options with agents on the Hub pinned to their commits."""
    return {name: pinned(value) if name in SIDES else value for name, value in options.items()}
