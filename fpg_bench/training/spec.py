"""What a training run is: made once, of what a caller says, and handed on as it is."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.checks import whole
from fpg_bench.errors import UserError
from fpg_bench.evaluation.field import field_of
from fpg_bench.ids import DUEL, VIEWS, find_view, sides_of
from fpg_bench.training.algorithms import Algorithm
from fpg_bench.training.hyperparameters import Hyperparameters


@dataclass(frozen=True)
class RunSpec:
    """Everything that tells one training run from another but its folder; a worker gets it whole.

    Attributes:
        algorithm: ``ppo``, ``ppo-fast``, ``sac``, ``td3``, ``recurrent-ppo``, ``ppo-stack8`` and the like,
            ``maddpg``, ``package.module:Class``, or a class of SB3's kind.
        view_id: ``FPG/AllyVsScripted-v0`` and the like; ``FPG/duel_v0`` for both sides.
        seed: the training seed k; games begin at seed k * 10^6.
        steps: the budget over all games, rounded up to what the algorithm collects at once; None: the
            hyper-parameter file's.
        hyperparams: a YAML file of one's own, or what it says for the id; None: the shipped one.
        field: under which the policy is scored on the way, on tuning seeds; None: the id's (both sides have
            one each).
        transcript: of a run with a language model: fly its plans again, without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, and ``server``, the profile of
            its endpoint.
        against: the other side's player, or a list to draw from per round, whatever that side's option is
            called.
        start: the folder of a finished run of one's own, of the same side, algorithm and networks: begin
            with its weights, optimiser and normalisation, and imitate nobody.
        options: those of :class:`fpg_bench.envs.core.OneSided`, or of
            :func:`fpg_bench.envs.duel.make_duel` where both sides learn.
    """

    algorithm: str | type[BaseAlgorithm]
    view_id: str
    seed: int = 0
    steps: int | None = None
    hyperparams: str | Path | Mapping[str, Any] | None = None
    field: str | None = None
    transcript: str | Path | None = None
    llm: Mapping[str, Any] | None = None
    against: Any = None
    start: str | Path | None = None
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(cls, algorithm: str | type[BaseAlgorithm], view_id: str, **words: Any) -> RunSpec:
        """A run in the words of :func:`fpg_bench.training.train.train`; others are options of its games."""
        own = {spec.name for spec in dataclasses.fields(cls)}
        said = {name: value for name, value in words.items() if name in own}
        options = {name: value for name, value in words.items() if name not in own}
        return cls(algorithm, view_id, **said, options=options)

    @property
    def id(self) -> str:
        """The id as it is registered."""
        return self.view_id.removeprefix("fpg_bench:")

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides that learn; raises UserError for an unknown id."""
        return sides_of(self.view_id)

    @property
    def planner(self) -> Any:
        """Who plans the opponent's path: who is named, else the id's own."""
        return self.options.get("planner") or (VIEWS[self.id].planner if self.id in VIEWS else None)

    def games(self) -> dict[str, Any]:
        """The options of its games, with the other side's players under that side's name.

        Raises:
            UserError: nobody can be named, or somebody is named twice.
        """
        if self.against is None:
            return dict(self.options)
        if self.id == DUEL:
            raise UserError(f"against: in {DUEL} both sides learn; name nobody")
        other = find_view(self.id).other_side
        if self.options.get(other) is not None:
            raise UserError(f"against: names the {other}, and so does {other}; say one of them")
        return {**self.options, other: self.against}

    def fields(self) -> list[str]:
        """What scores each of the sides; raises UserError where one is named for both."""
        if self.field and len(self.sides) == 2:
            raise UserError(f"field: each side of {DUEL} is scored by its own; name none")
        games = self.games()
        return [self.field] if self.field else [field_of(self.id, games, side) for side in self.sides]

    def budget(self, algorithm: Algorithm, parameters: Hyperparameters) -> int:
        """The steps of the run; raises UserError where nobody says how many, or says it wrongly."""
        budget = parameters.n_timesteps if self.steps is None else whole(self.steps, "steps")
        if not budget:
            raise UserError(f"steps: {algorithm.name} has no hyper-parameter file that says how many; say it")
        return budget

    def told(self) -> dict[str, Any]:
        """All that the command line says of the run behind algorithm, id, seed and steps, but its file."""
        llm = {name.removesuffix("_s"): value for name, value in (self.llm or {}).items()}
        told = {**self.games(), "transcript": self.transcript, "start": self.start, **llm}
        return {name: value for name, value in told.items() if value is not None}

    def check_sides(self, algorithm: Algorithm) -> None:
        """Raise UserError where an algorithm of one side is asked for both, or the other way round."""
        if algorithm.joint != (len(self.sides) == 2):
            both = "trains both sides, in" if algorithm.joint else "trains one side, not both, as in"
            raise UserError(f"{algorithm.name}: {both} {DUEL}; got {self.view_id}")
