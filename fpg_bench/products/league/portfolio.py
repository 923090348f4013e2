"""Portfolio of responses to a player within a budget of CPU seconds: scripts, rules, tables, PPO, and pupils.

A pupil is PPO that first imitates the strongest of the others.

No kind of search finds the lowest return of every player, so what a player is known to keep is the minimum
over all of them, measured on seeds on which none was chosen.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_json
from fpg_bench.common.ids import ALL_TACTICS, SCRIPTS, other_side
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import Strict, parse
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.tactics import draw_variants
from fpg_bench.products.league.best_responses import RESPONSE_REWARDS, ResponseTarget, find_target
from fpg_bench.products.league.config import GAME, REWARDS, RuleSearchConfig, check_budget
from fpg_bench.products.league.evaluation import MATCHES
from fpg_bench.products.league.folder import check_same
from fpg_bench.products.league.rule_search import rule_search
from fpg_bench.products.league.tabular import (
    DEFAULT_FEATURES,
    Kept,
    Settings,
    count_cells,
    measure,
    settings_of,
    tabular_response,
    training_seeds,
)
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

ROWS, RESULT = "portfolio.jsonl", "portfolio.json"
METHODS = ("rule", "tabular", "pupil", "ppo")  # in turn, after the scripts
MOST_DRAWN_CELLS = 120
RULE_BUDGET, TABLE_BUDGET = 10.0, 200.0  # CPU seconds
N_SCRIPTS = 40  # with random constants
ALGORITHM, STEPS, IMITATION_STEPS = "ppo-stack8", 1_500_000, 400_000  # of PPO; pupils imitate in addition
# Edges from which the features of all tables but the first are drawn.
EDGES: Mapping[str, Mapping[str, Sequence[float]]] = {
    "ally": {
        "since_hit_s": (1, 2, 3, 6),
        "sensed_type": (1, 2, 3, 4),
        "hits": (2, 3),
        "covered": (1,),
        "distance_m": (35, 90),
        "snr_db": (0, 10, 20),
        "spreading_s": (1, 3, 6),
    },
    "opponent": {
        "known_age_s": (1, 2, 3, 4, 5),
        "distance_m": (20, 35, 60, 90),
        "same_point": (1, 2),
        "next_check_s": (2, 3, 4),
        "since_check_s": (1, 2, 3),
        "own_type": (1, 2, 3, 4),
        "last_check": (0, 1),
    },
}
_STEPS_PER_S = 8_000  # of PPO, at least; what it costs is known after the first training
_logger = logging.getLogger(__name__)


class Found(Kept):
    """Return of a training seed against the strongest response to it, with its interval.

    Attributes:
        response: the script, or the folder of the agent.
        method: how it was found: ``script``, ``rule``, ``tabular``, ``pupil`` or ``ppo``.
        seconds: CPU seconds of this response alone.
        spent: CPU seconds of the search until it was found.
    """

    response: str
    method: str
    seconds: float
    spent: float


class PortfolioResult(Settings):
    """Content of ``portfolio.json``; see :func:`portfolio`."""

    seconds: float
    returns: dict[str, Found]
    lowest: str


def portfolio(
    agent: str,
    out: str | Path,
    *,
    budget: float = 3600.0,
    seed: int = 0,
    reward: str | None = None,
    side: str | None = None,
    scenario: str | Path | None = None,
    path: str | Sequence[str] | None = None,
    allow: Collection[str] = (),
) -> PortfolioResult:
    """Search the strongest response to a fixed player by several methods, within a budget of CPU seconds.

    First all scripts are played, and some with random constants. Then come in turn a short rule
    (:func:`fpg_bench.products.league.rule_search.rule_search`), a table
    (:func:`fpg_bench.products.league.tabular.tabular_response`, with features that are drawn from the second
    on), a pupil, which is PPO that first imitates the strongest response that is no pupil, and PPO from
    nothing; each answers the next training seed of the player's group, and is played against all. What is
    estimated to take longer than the budget is not begun. A stopped call is resumed, and a larger budget
    continues a finished one.

    Args:
        agent: the player, or a group of training seeds; as for ``tabular_response``.
        out: a folder for ``portfolio.jsonl``, a row per response; the folders of responses, ``tabular_0`` and
            so on; and ``portfolio.json``, the settings and the result.
        budget: CPU seconds of all responses.
        seed: training seed of the first table and the first trainings; the next ones have the next seeds.
        reward, side, scenario, path: as for ``tabular_response``.
        allow: the ``package.module:object`` and agents of the Hub that files may name.

    Returns:
        The content of ``portfolio.json``: the settings; ``seconds`` of CPU; ``returns``, what each training
        seed keeps per step against the response that is strongest on tuning seeds, in 300 matches on
        evaluation seeds with its 95 % interval, who found it and for how many CPU seconds; and ``lowest``,
        the training seed that keeps least.

    Raises:
        UserError: as ``tabular_response``, and for invalid hyper-parameters.
        KeyboardInterrupt: stopped by the user.
    """
    check_budget(budget)
    seeds = training_seeds(agent, side)
    target = find_target(agent if agent in seeds else seeds[0], side, {"scenario": scenario, "path": path})
    reward = RESPONSE_REWARDS[target.side] if reward is None else one_of(reward, "reward", REWARDS)
    settings, folder = settings_of(target, seeds, reward, seed), Path(out)
    about: Row = dict(settings)
    file = RowFile(folder / ROWS)
    with own_folder(folder, RESULT, "portfolio"):
        rows = [_Response.read(row, seeds, f"rows {file.path}") for row in file.read()]
        if (folder / RESULT).exists():
            check_same(folder / RESULT, "a portfolio", about)
        else:
            write_json(folder / RESULT, about)
        search = _Portfolio(target, seeds, folder, reward, seed, (scenario, path), rows, file)
        other = other_side(target.side)
        variants = draw_variants(other, N_SCRIPTS, target.scenario, seed, ALL_TACTICS[other])
        for name in (*SCRIPTS[other], *variants):
            if search.spent < budget:
                search.add(name, "script")
        best = min(search.rows, key=lambda row: min(row.returns.values()), default=None)
        if best is not None:
            search.log(f"strongest of {len(search.rows)}, {best.response}", best)
        for number, method in ((k, method) for k in count() for method in METHODS):
            left = budget - search.spent
            if left <= 0:
                break
            if method == "rule":
                search.add_rule(number, min(RULE_BUDGET, left))
            elif method == "tabular":
                search.add_table(number, min(TABLE_BUDGET, left))
            elif search.estimate(method) <= left:
                search.add_training(number, method, allow)
        returns = {name: search.strongest(name) for name in seeds}
        result: PortfolioResult = {
            **settings,
            "seconds": round(search.spent, 1),
            "returns": returns,
            "lowest": min(returns, key=lambda name: returns[name]["return"]),
        }
        write_json(folder / RESULT, result)
    return result


def draw_features(side: str, number: int, seed: int) -> dict[str, list[float]]:
    """Return the features of a portfolio's table: the default ones first, then two or more at random."""
    if number == 0:
        return {name: list(map(float, edges)) for name, edges in DEFAULT_FEATURES[side].items()}
    rng, drawn = np.random.default_rng([seed, number]), dict[str, list[float]]()
    for name in rng.permutation(sorted(EDGES[side])).tolist():
        more = drawn | {name: list(map(float, EDGES[side][name]))}
        if count_cells(more) <= MOST_DRAWN_CELLS:
            drawn = more
    return drawn


class _Response(Strict):
    """A row of ``portfolio.jsonl``.

    Attributes:
        response: the script, or the folder of the agent relative to that of the portfolio.
        method: how it was found.
        answers: the training seed that it answers; None for a script.
        steps: steps of its training; None where it was not trained.
        seconds: CPU seconds.
        returns: what each training seed keeps per step, on tuning seeds.
    """

    response: str
    method: Literal["script", "rule", "tabular", "pupil", "ppo"]
    answers: str | None = None
    steps: int | None = None
    seconds: float
    returns: dict[str, float]

    @classmethod
    def read(cls, row: Row, seeds: Sequence[str], where: str) -> _Response:
        """Return the response of a row; raise UserError for one of other training seeds, or of code."""
        check_allowed(row.get("response"), (), where)
        response = parse(cls, row, where)
        if list(response.returns) != list(seeds):
            raise UserError(f"{where}: {response.response}: returns: expected those of {', '.join(seeds)}")
        return response


def _steps_of(method: str) -> int:
    """Return how many steps a training plays."""
    return STEPS + IMITATION_STEPS if method == "pupil" else STEPS


@dataclass
class _Portfolio:
    """The responses so far.

    Attributes:
        target: the player that is answered, with the game.
        seeds: its training seeds.
        folder: where the folders of responses are.
        reward: reward of the responses.
        seed: training seed of the first ones.
        asked: the scenario and path that the caller set.
        rows: rows of the responses, in ``file``.
    """

    target: ResponseTarget
    seeds: list[str]
    folder: Path
    reward: str
    seed: int
    asked: tuple[str | Path | None, str | Sequence[str] | None]
    rows: list[_Response]
    file: RowFile

    @property
    def spent(self) -> float:
        """CPU seconds so far."""
        return float(sum(row.seconds for row in self.rows))

    def estimate(self, method: str) -> float:
        """Return how many CPU seconds a training will take: as many as the last one of its kind."""
        steps = _steps_of(method)
        known = [row.seconds for row in self.rows if row.method == method and row.steps == steps]
        return known[-1] if known else steps / _STEPS_PER_S

    def add(
        self,
        response: str,
        method: str,
        make: Callable[[], float] = lambda: 0.0,
        answers: str | None = None,
        steps: int | None = None,
    ) -> None:
        """Make a response that has no row yet, and play it against all training seeds.

        Args:
            response, method, answers, steps: as in its row.
            make: makes it; returns CPU seconds that earlier calls spent on it.
        """
        if any(row.response == response for row in self.rows):
            return
        began = time.process_time()
        before = make()
        place = self._place(response, method)
        returns = {
            name: measure(name, place, self.target, MATCHES, tuning_seeds)["return"] for name in self.seeds
        }
        row = _Response(
            response=response,
            method=cast("Any", method),
            answers=answers,
            steps=steps,
            seconds=round(time.process_time() - began + before, 3),
            returns=returns,
        )
        self.file.append([row.model_dump(exclude_none=True)])
        self.rows.append(row)
        if method != "script":
            self.log(response, row)

    def log(self, what: str, row: _Response) -> None:
        """Log what a row found, and the CPU seconds so far."""
        _logger.info(f"{what}: lowest {min(row.returns.values()):.2f} per step; spent {self.spent:.0f} CPU s")

    def add_rule(self, number: int, budget: float) -> None:
        """Add a rule."""
        name, answered = f"rule_{number}", self._answered(number)
        config = RuleSearchConfig(
            side=other_side(self.target.side),
            against=[answered],
            reward=self.reward,
            budget=budget,
            seed=self.seed + number,
            game={key: value for key, value in self.target.game.to_dict().items() if key in GAME},
        )

        def make() -> float:
            began = time.process_time()
            made = rule_search(config, self.folder / name, progress=False)
            return max(made["seconds"] - (time.process_time() - began), 0.0)

        self.add(f"{name}/agent", "rule", make, answers=answered)

    def add_table(self, number: int, budget: float) -> None:
        """Add a table."""
        name, answered = f"tabular_{number}", self._answered(number)
        features = draw_features(other_side(self.target.side), number, self.seed)

        def make() -> float:
            began = time.process_time()
            made = tabular_response(
                answered,
                self.folder / name,
                budget=budget,
                features=features,
                seed=self.seed + number,
                reward=self.reward,
                side=self.target.side,
                scenario=self.asked[0],
                path=self.asked[1],
                progress=False,
            )
            return max(made["seconds"] - (time.process_time() - began), 0.0)

        self.add(f"{name}/agent", "tabular", make, answers=answered)

    def add_training(self, number: int, method: str, allow: Collection[str]) -> None:
        """Add PPO from nothing, or a pupil of the strongest response that is none."""
        answered, run = self._answered(number), RunFolder(self.folder / f"{method}_{number}")
        game = GameSpec.of(
            self.target.game, reward=self.reward, actions="discrete", **{self.target.side: answered}
        )
        values = load_hyperparameters(ALGORITHM, game, allow=allow).entry()
        if method == "pupil":
            others = [row for row in self.rows if row.method != method]
            teacher = min(others, key=lambda row: row.returns[answered])
            place = self._place(teacher.response, teacher.method)
            values |= {"imitate": {"teacher": place, "steps": IMITATION_STEPS}}
        config = RunConfig(ALGORITHM, game, self.seed + number, STEPS, values)

        def make() -> float:
            train(config, run.path, evaluations=0, progress=False, resume=True)
            ran = run.read()
            return float(ran.seconds) if ran.part else 0.0  # wall-clock time, where parts were other calls

        self.add(f"{run.path.name}/agent", method, make, answers=answered, steps=_steps_of(method))

    def strongest(self, name: str) -> Found:
        """Return what a training seed keeps on fresh seeds against what is strongest on tuning seeds."""
        index = min(range(len(self.rows)), key=lambda k: self.rows[k].returns[name])
        row = self.rows[index]
        return {
            **measure(name, self._place(row.response, row.method), self.target),
            "response": row.response,
            "method": row.method,
            "seconds": row.seconds,
            "spent": round(sum(each.seconds for each in self.rows[: index + 1]), 1),
        }

    def _place(self, response: str, method: str) -> str:
        """Return the name by which a response plays."""
        return response if method == "script" else str(self.folder / response)

    def _answered(self, number: int) -> str:
        """Return the training seed that a response answers: the first one first, then the others in turn."""
        first = self.seeds.index(self.target.agent)
        return self.seeds[(first + number) % len(self.seeds)]
