"""Configuration of a training run."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.common.checks import integer, mapping, of_kind
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import SIDES
from fpg_bench.players.remote import pinned
from fpg_bench.training.algorithms import OFFLINE, find_algorithm

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

LOADED = "fpg_bench.training.loaded"  # module that imports what each training needs
N_EVALS = 10  # each plays some 30,000 steps
Hyperparams = str | Path | Mapping[str, object] | None  # a YAML file, an entry; None: what is shipped


@dataclass(frozen=True)
class RunConfig:
    """Everything that distinguishes one training run from another, apart from its folder.

    >>> config = RunConfig("ppo", GameSpec("FPG/AllyVsScripted-v0", path="circle"), steps=100_000)
    >>> config.spec.path, config.suites()
    (('circle',), ['ally-v2'])

    Attributes:
        algorithm: one of :data:`fpg_bench.training.algorithms.ALGORITHMS` and the like,
            ``package.module:Class``, or a class with Stable-Baselines3's interface.
        game: the game, or an environment id for instance ``FPG/AllyVsScripted-v0``; ``FPG/duel_v0`` trains
            both sides. Names of agents on the Hub are pinned to their commits.
        seed: training seed k; its games start at game seed k * 10^6.
        steps: training budget over all games, such as 2e6, of offline algorithms in gradient steps; None:
            that of the hyper-parameters. It is rounded up to whole rollouts.
        hyperparams: hyper-parameters: a YAML file with an entry for the id, or a shipped name such as
            ``ppo-fast``; None: the shipped file. In Python also the entry itself.
        suite: suite that scores the policy during training, on tuning seeds; None: that of the id, whose
            rivals then play the run's scenario. A suite that is named must be of this scenario.
        start: folder of a finished run with the initial weights; ``ppo`` can also start from a run of ``bc``.
            It is of the same side, algorithm and networks; the new run has its optimizer and normalization,
            too, and skips imitation.
        planner_options: options of the planner by name, which the product checks that offers it; see
            :class:`fpg_bench.products.language_models.options.TrainingOptions`.
        allow: what files may load: ``package.module:object``, or an agent of the Hub. What the files of the
            hyper-parameters, of the suite and of a game name is not run on their word.
        dataset: data set of an offline algorithm, a :class:`fpg_bench.products.offline.read.Dataset`; see
            :meth:`offline`.
    """

    algorithm: str | type[BaseAlgorithm]
    game: GameSpec | str
    seed: int = 0
    steps: int | None = None
    hyperparams: Hyperparams = None
    suite: str | None = None
    start: str | Path | None = None
    planner_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    dataset: Any = None
    allow: Collection[str] = ()

    def __post_init__(self) -> None:
        spec = GameSpec.of(self.game, allow=of_kind(self.allow, "allow", "a collection of names", Collection))
        spec.check_trusted()
        object.__setattr__(self, "seed", integer(self.seed, "seed", 0))
        if self.steps is not None:
            object.__setattr__(self, "steps", integer(self.steps, "steps"))
        pins = {side: pinned(getattr(spec, side)) for side in SIDES}
        object.__setattr__(self, "game", dataclasses.replace(spec, **pins))

    @classmethod
    def offline(cls, algorithm: str, dataset: Any, **options: Any) -> RunConfig:
        """Return the configuration of a run that learns from a data set.

        Args:
            algorithm: one of :data:`fpg_bench.training.algorithms.OFFLINE`, with or without stacked frames.
            dataset: the data set, a :class:`fpg_bench.products.offline.read.Dataset`.
            **options: further attributes.

        Raises:
            UserError: an algorithm that does not learn from data sets, or not from this action mode.
        """
        spec, known = dataset.spec, find_algorithm(algorithm)
        if not known.offline or spec.actions not in known.kind.modes:
            fitting = [name for name in OFFLINE if spec.actions in find_algorithm(name).kind.modes]
            raise UserError(
                f"{algorithm}: does not learn from a data set of {spec.actions} actions, as {spec.name} is; "
                f"these do: {', '.join(fitting)}"
            )
        return cls(algorithm, spec.game, dataset=dataset, **options)

    @property
    def spec(self) -> GameSpec:
        """The game."""
        assert isinstance(self.game, GameSpec)
        return self.game

    @property
    def planner(self) -> Any:
        """The planner of the opponent's path: the one that is set, else the default of the id."""
        return self.spec.planner or (None if self.spec.is_duel else self.spec.config.planner)

    def suites(self) -> list[str]:
        """Return the suite that scores each side.

        Raises:
            UserError: one suite is set for both sides, is of another scenario, or does not exist.
        """
        from fpg_bench.evaluation.suite import read_suite, suite_of  # with all that reads suites

        if self.suite and self.spec.is_duel:
            raise UserError(f"suite: each side of {DUEL} is scored on its own suite; omit it")
        usual = [suite_of(self.spec, side) for side in self.spec.sides]
        if self.suite is None or self.suite in usual:
            return usual
        read_suite(self.suite).check_scenario(self.spec.resolve())
        return [self.suite]

    def options(self) -> dict[str, object]:
        """Return the options beside those of the game: ``start``, and those of the planner."""
        return dict(mapping(self.planner_options, "planner_options")) | (
            {} if self.start is None else {"start": self.start}
        )
