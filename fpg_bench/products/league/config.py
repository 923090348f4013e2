"""Configurations of league training, one for each algorithm; their fields are the options of its verb."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from fpg_bench.common.checks import check_keys, integer, one_of
from fpg_bench.common.errors import UserError
from fpg_bench.players.player import SIDES
from fpg_bench.training.config import Hyperparams

GAME = ("scenario", "path", "knowledge", "jamming_types")  # options of a game that both sides share
META_SOLVERS, SEARCHES = ("weights", "nash"), ("tabular", "portfolio")
GOALS, REWARDS = ("mean", "lowest"), ("zero_sum", "own")  # of searches without a network
# Known words, and least values, of fields
WORDS = {"side": SIDES, "meta_solver": META_SOLVERS, "search": SEARCHES}
LEAST = dict.fromkeys(("seed", "n_evals"), 0) | dict.fromkeys(
    ("steps", "response_steps", "n_seeds", "iterations", "weight", "patience"), 1
)


@dataclass(frozen=True, kw_only=True)
class LeagueConfig:
    """Base class of the configurations of all algorithms.

    Attributes:
        algorithm: algorithm that is trained, as for ``train``.
        steps: training budget of one training.
        hyperparams: hyper-parameters: a YAML file with an entry for the id, or a shipped name such as
            ``ppo-fast``; None: the shipped file. In Python also the entry itself.
        allow: what files may load: ``package.module:object``, or an agent of the Hub. What the files of the
            hyper-parameters name is not run on their word.
        game: options of the game that both sides share, those of :data:`GAME`.

    Raises:
        UserError: something unknown or out of range.
    """

    verb: ClassVar[str]

    algorithm: str = "ppo"
    steps: int = 500_000
    hyperparams: Hyperparams = None
    allow: Collection[str] = ()
    game: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        check_keys(self.game, GAME, "game")
        given = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        for name, value in given.items():
            if name in LEAST and value is not None:
                integer(value, name, LEAST[name])
            if name in WORDS and value is not None:
                one_of(value, name, WORDS[name])


@dataclass(frozen=True, kw_only=True)
class BestResponseConfig(LeagueConfig):
    """Best responses to a fixed player, of one kind or of several.

    Attributes:
        agent: the player: a shipped agent, a folder, a script, or ``package.module:object``.
        side: side of the player; None: that of the agent or the script.
        steps: training budget of each response.
        n_seeds: number of responses, with training seeds from 0 on.
        reward: reward of the responses: ``zero_sum``, to lower the player's return, or ``own``, to raise the
            response's; None: ``zero_sum`` against an ally, ``own`` against an opponent. In Python also any
            other of :data:`fpg_bench.game.spec.REWARDS`.
        actions: action mode of the responses; None: ``continuous``.
        search: in place of one training after the other, ``tabular``, a table of few features, or
            ``portfolio``: scripts, rules, tables, PPO, and PPO that first imitates the strongest of these, in
            turn.
        budget: CPU seconds of a search.
        game: options of the game in place of those of the player's training.
    """

    verb = "best-response"
    agent: str
    side: str | None = None
    n_seeds: int = 3
    reward: str | None = None
    actions: str | None = None
    search: str | None = None
    budget: float = 200.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.search is not None:
            if self.actions is not None:
                raise UserError("actions: --search decides the actions of its responses; omit it")
            if self.reward is not None:
                one_of(self.reward, "reward", REWARDS)
            check_budget(self.budget)


@dataclass(frozen=True, kw_only=True)
class DoubleOracleConfig(LeagueConfig):
    """Double oracle (PSRO): a side answers responses, and responses the side.

    Attributes:
        side: the side that learns: ``ally`` or ``opponent``.
        iterations: the most iterations.
        algorithm: algorithm of the side, as for ``train``.
        actions: action mode of the side; None: ``continuous``.
        meta_solver: who is answered: ``weights``, the side answers all rivals by their weights, a response
            the side's newest policy; or ``nash``, each side answers the other's equilibrium.
        weight: how often a response is listed among the rivals, by ``weights``.
        steps: training budget of an iteration.
        against: rivals of the side's first training; None: all scripts of the other side. ``tone*8`` counts
            eight times, ``suite:NAME`` stands for all members of a suite.
        response_algorithm: algorithm of the responses.
        response_actions: action mode of the responses.
        response_steps: training budget of a response; None: that of an iteration.
        response_hyperparams: hyper-parameters of the responses.
        patience: stop after as many iterations without a higher low.
        seed: seed of the trainings.
    """

    verb = "double-oracle"

    algorithm: str = "ppo-stack8"
    steps: int = 1_000_000
    side: str = "ally"
    iterations: int = 3
    actions: str | None = None
    against: str | Sequence[str] | None = None
    weight: int = 8
    response_algorithm: str = "ppo-stack8"
    response_actions: str = "discrete"
    response_steps: int | None = None
    response_hyperparams: Hyperparams = None
    patience: int = 2
    seed: int = 0
    meta_solver: str = "weights"


@dataclass(frozen=True, kw_only=True)
class TabularSelfPlayConfig:
    """Self-play of two stochastic tables; the exported one is the ally.

    Attributes:
        iterations: iterations, of a round of every game each.
        games: games of a batch.
        seed: training seed.
    """

    verb: ClassVar[str] = "tabular-self-play"
    algorithm: ClassVar[str] = "tabular"
    side: ClassVar[str] = "ally"

    iterations: int = 700
    games: int = 1024
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("iterations", "games", "seed"):
            integer(getattr(self, name), name, LEAST.get(name, 1))


@dataclass(frozen=True, kw_only=True)
class RuleSearchConfig:
    """Search for a rule.

    Attributes:
        side: side of the rule: ``ally`` or ``opponent``.
        against: its rivals; None: all scripts of the other side. ``suite:NAME`` stands for all members of a
            suite.
        goal: what is raised: the ``mean`` return over the rivals, or the ``lowest`` of them.
        reward: ``own``, or ``zero_sum``, what the rivals lose.
        budget: CPU seconds of the search, over all calls; the generation that it ends in is finished.
        seed: training seed.
        allow: the ``package.module:object`` and agents of the Hub that files may name.
        game: options of the game that both sides share.
    """

    verb: ClassVar[str] = "rule-search"
    algorithm: ClassVar[str] = "rule"

    side: str = "ally"
    against: str | Sequence[str] | None = None
    goal: str = "mean"
    reward: str = "own"
    budget: float = 40.0
    seed: int = 0
    allow: Collection[str] = ()
    game: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        check_keys(self.game, GAME, "game")
        one_of(self.side, "side", SIDES)
        one_of(self.goal, "goal", GOALS)
        one_of(self.reward, "reward", REWARDS)
        integer(self.seed, "seed", 0)
        check_budget(self.budget)


def check_budget(budget: float) -> None:
    """Raise UserError for a budget of nothing."""
    if not (isinstance(budget, int | float) and math.isfinite(budget) and budget > 0):
        raise UserError(f"budget: expected CPU seconds above 0, got {budget}")
