"""Best responses to a fixed player: scripts, rules, tables, and agents that are trained against it.

No kind of search finds the lowest return of every player, so what a player is known to keep is the minimum
over all of them, measured on seeds on which none was chosen.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_json
from fpg_bench.common.ids import ALL_TACTICS, SCRIPTS, other_side
from fpg_bench.common.imports import check_allowed, code_fingerprint
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import Strict, parse
from fpg_bench.evaluation.seeds import PROTOCOL, tuning_seeds
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.registry import as_player, policy_hash
from fpg_bench.players.tactics import draw_variants
from fpg_bench.products.league.config import GAME, BestResponseConfig, RuleSearchConfig
from fpg_bench.products.league.evaluation import MATCHES
from fpg_bench.products.league.folder import check_same
from fpg_bench.products.league.rule_search import rule_search
from fpg_bench.products.league.tabular import DEFAULT_FEATURES, count_cells, table_search
from fpg_bench.products.league.targets import RESPONSE_REWARDS, ResponseTarget, find_target, training_seeds
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import check_run, is_finished, train

ROWS, RESULT = "best_responses.jsonl", "best_responses.json"
METHODS = ("rule", "tabular", "pupil", "ppo")  # of a portfolio in turn, after the scripts
MOST_DRAWN_CELLS = 120
RULE_BUDGET, TABLE_BUDGET = 10.0, 200.0  # CPU seconds, in a portfolio
N_SCRIPTS = 40  # with random constants
FINAL_MATCHES = 300  # on evaluation seeds, after the choice
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


def best_responses(config: BestResponseConfig, out: str | Path, *, progress: bool = True) -> Row:
    """Search the strongest response to a fixed player, by one method or by several.

    First all scripts are played, and in a portfolio some with random constants. By default agents are then
    trained with one algorithm. ``search="tabular"`` searches a table
    (:func:`fpg_bench.products.league.tabular.table_search`) instead of both. A portfolio goes on in turn with
    a short rule (:func:`fpg_bench.products.league.rule_search.rule_search`), a table, with features that are
    drawn from the second on, a pupil, which is PPO that first imitates the strongest response that is no
    pupil, and PPO from nothing; each answers the next training seed of the player's group, and what is
    estimated to take longer than the budget is not begun.

    The opponent's path is that of the player's training: ``learned`` where it was among its paths, else
    ``pursuit``. A stopped call is resumed, a larger budget continues a finished search, and calls with other
    configurations add their responses.

    Args:
        config: the player, and the kind of responses; of a group of training seeds, the first is answered.
        out: a folder for ``best_responses.jsonl``, a row per response; the folders of responses, such as
            ``ppo-500000/seed_0`` and ``tabular_0``; and ``best_responses.json``, the result.
        progress: show the progress of trainings and tables.

    Returns:
        The content of ``best_responses.json``: the player and the game; ``seconds`` of CPU; ``returns``, what
        each training seed keeps per step against the response that is strongest on tuning seeds, in 300
        matches on evaluation seeds with its 95 % interval, who found it and for how many CPU seconds; and
        ``lowest``, the training seed that keeps least. It is an upper bound of the player's worst return:
        another response may find a lower one.

    Raises:
        UserError: no such player, a player whose training scenario no longer exists, invalid
            hyper-parameters, or a folder with other files or with responses to another player.
        KeyboardInterrupt: stopped by the user.
    """
    seeds, folder = training_seeds(config.agent, config.side), Path(out)
    agent = config.agent if config.agent in seeds else seeds[0]
    target = find_target(agent, config.side, config.game)
    players = {name: as_player(name, target.side, target.scenario) for name in seeds}
    search = _Responses(config, target, seeds, folder, progress)
    about: Row = {
        "side": target.side,
        "policies": {name: policy_hash(of) or code_fingerprint(name) for name, of in players.items()},
        "scenario": target.scenario.hash,
        "path": target.game.to_dict()["path"],
        "reward": search.reward,
        "protocol": PROTOCOL,
    }
    if config.search is None:
        check_run(search.run(0))
    with own_folder(folder, RESULT, "best responses"):
        if (folder / RESULT).exists():
            check_same(folder / RESULT, "best responses", about)
        else:
            write_json(folder / RESULT, about)
        search.read()
        if config.search == "portfolio":
            search.add_portfolio()
        elif config.search == "tabular":
            search.add_table(0, config.budget)
        else:
            search.add_scripts(SCRIPTS[other_side(target.side)])
            for seed in range(config.n_seeds):
                search.add_training(seed)
        returns = {name: search.strongest(name) for name in seeds}
        lowest = min(returns, key=lambda name: returns[name]["return"])
        about |= {"seconds": round(search.spent, 1), "returns": returns, "lowest": lowest}
        write_json(folder / RESULT, about)
    return about


def draw_features(side: str, number: int) -> dict[str, list[float]]:
    """Return the features of a portfolio's table: the default ones first, then two or more at random."""
    if number == 0:
        return {name: list(map(float, edges)) for name, edges in DEFAULT_FEATURES[side].items()}
    rng, drawn = np.random.default_rng([0, number]), dict[str, list[float]]()
    for name in rng.permutation(sorted(EDGES[side])).tolist():
        more = drawn | {name: list(map(float, EDGES[side][name]))}
        if count_cells(more) <= MOST_DRAWN_CELLS:
            drawn = more
    return drawn


class _Response(Strict):
    """A row of ``best_responses.jsonl``.

    Attributes:
        response: the script, or the folder of the agent relative to that of all.
        method: how it was found.
        answers: the training seed that it answers; None for a script.
        steps: steps of its training; None where it was not trained.
        seconds: CPU seconds.
        returns: what each training seed keeps per step, on tuning seeds.
    """

    response: str
    method: Literal["script", "training", "rule", "tabular", "pupil", "ppo"]
    answers: str | None = None
    steps: int | None = None
    seconds: float
    returns: dict[str, float]


def _steps_of(method: str) -> int:
    """Return how many steps a training of a portfolio plays."""
    return STEPS + IMITATION_STEPS if method == "pupil" else STEPS


@dataclass
class _Responses:
    """The responses so far.

    Attributes:
        config: the player, and the kind of responses.
        target: the player that is answered, with the game.
        seeds: its training seeds.
        folder: where the folders of responses are.
        progress: show the progress of trainings and tables.
        rows: rows of the responses.
    """

    config: BestResponseConfig
    target: ResponseTarget
    seeds: list[str]
    folder: Path
    progress: bool

    def __post_init__(self) -> None:
        self.rows = list[_Response]()
        self._file = RowFile(self.folder / ROWS)

    @property
    def reward(self) -> str:
        """Reward of the responses."""
        return self.config.reward or RESPONSE_REWARDS[self.target.side]

    @property
    def spent(self) -> float:
        """CPU seconds so far."""
        return float(sum(row.seconds for row in self.rows))

    def read(self) -> None:
        """Read the rows; raise UserError for one of other training seeds, or of code."""
        where = f"rows {self._file.path}"
        for row in self._file.read():
            check_allowed(row.get("response"), (), where)
            self.rows.append(parse(_Response, row, where))
            if list(self.rows[-1].returns) != self.seeds:
                raise UserError(f"{where}: returns: expected those of {', '.join(self.seeds)}")

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
            name: self.target.kept(name, place, MATCHES, tuning_seeds)["return"] for name in self.seeds
        }
        row = _Response(
            response=response,
            method=cast("Any", method),
            answers=answers,
            steps=steps,
            seconds=round(time.process_time() - began + before, 3),
            returns=returns,
        )
        self._file.append([row.model_dump(exclude_none=True)])
        self.rows.append(row)
        if method != "script":
            self._log(response, row)

    def _log(self, what: str, row: _Response) -> None:
        """Log what a row found, and the CPU seconds so far."""
        _logger.info(f"{what}: lowest {min(row.returns.values()):.2f} per step; spent {self.spent:.0f} CPU s")

    def add_scripts(self, names: Sequence[str]) -> None:
        """Add scripts."""
        for name in names:
            if self.config.search is None or self.spent < self.config.budget:
                self.add(name, "script")
        if self.rows:
            best = min(self.rows, key=lambda row: min(row.returns.values()))
            self._log(f"strongest of {len(self.rows)}, {best.response}", best)

    def add_portfolio(self) -> None:
        """Add scripts, then rules, tables and trainings in turn, within the budget."""
        other = other_side(self.target.side)
        variants = draw_variants(other, N_SCRIPTS, self.target.scenario, 0, ALL_TACTICS[other])
        self.add_scripts([*SCRIPTS[other], *variants])
        for number, method in ((k, method) for k in count() for method in METHODS):
            left = self.config.budget - self.spent
            if left <= 0:
                break
            if method == "rule":
                self.add_rule(number, min(RULE_BUDGET, left))
            elif method == "tabular":
                self.add_table(number, min(TABLE_BUDGET, left))
            elif self._estimate(method) <= left:
                self.add_ppo(number, method)

    def _estimate(self, method: str) -> float:
        """Return how many CPU seconds a training will take: as many as the last one of its kind."""
        steps = _steps_of(method)
        known = [row.seconds for row in self.rows if row.method == method and row.steps == steps]
        return known[-1] if known else steps / _STEPS_PER_S

    def add_rule(self, number: int, budget: float) -> None:
        """Add a rule."""
        name, answered = f"rule_{number}", self._answered(number)
        config = RuleSearchConfig(
            side=other_side(self.target.side),
            against=[answered],
            reward=self.reward,
            budget=budget,
            seed=number,
            game={key: value for key, value in self.target.game.to_dict().items() if key in GAME},
        )
        self._add_search(
            name, "rule", answered, lambda: rule_search(config, self.folder / name, progress=False)["seconds"]
        )

    def add_table(self, number: int, budget: float) -> None:
        """Add a table."""
        name, answered = f"tabular_{number}", self._answered(number)
        features = draw_features(other_side(self.target.side), number)

        def search() -> float:
            game, place = self._game(answered), self.folder / name
            return table_search(game, features, place, budget=budget, seed=number, progress=self.progress)

        self._add_search(name, "tabular", answered, search)

    def _add_search(self, name: str, method: str, answered: str, search: Callable[[], float]) -> None:
        """Add what a search finds, which returns its CPU seconds in all calls."""

        def make() -> float:
            began = time.process_time()
            return max(search() - (time.process_time() - began), 0.0)

        self.add(f"{name}/agent", method, make, answers=answered)

    def add_ppo(self, number: int, method: str) -> None:
        """Add PPO from nothing, or a pupil of the strongest response that is none."""
        answered, game = self._answered(number), self._game(self._answered(number), actions="discrete")
        values = load_hyperparameters(ALGORITHM, game, allow=self.config.allow).entry()
        if method == "pupil":
            others = [row for row in self.rows if row.method != method]
            teacher = min(others, key=lambda row: row.returns[answered])
            place = self._place(teacher.response, teacher.method)
            values |= {"imitate": {"teacher": place, "steps": IMITATION_STEPS}}
        run = RunConfig(ALGORITHM, game, number, STEPS, values)
        self._add_run(run, f"{method}_{number}", method, answered, _steps_of(method))

    def run(self, seed: int) -> RunConfig:
        """Return a training of the configuration."""
        config, game = self.config, self._game(self.target.agent, actions=self.config.actions)
        values = load_hyperparameters(config.algorithm, game, config.hyperparams, allow=config.allow).entry()
        return RunConfig(config.algorithm, game, seed, config.steps, values)

    def add_training(self, seed: int) -> None:
        """Add a training of the configuration."""
        config, run = self.config, self.run(seed)
        actions = "" if config.actions in (None, "continuous") else f"-{config.actions}"
        name = f"{config.algorithm}{actions}-{config.steps}/seed_{seed}"
        is_finished(run, self.folder / name)  # which refuses another run there
        self._add_run(run, name, "training", self.target.agent, config.steps)

    def _add_run(self, run: RunConfig, name: str, method: str, answered: str, steps: int) -> None:
        folder = RunFolder(self.folder / name)

        def make() -> float:
            train(run, folder.path, evaluations=0, progress=self.progress, resume=True)
            ran = folder.read()
            return float(ran.seconds) if ran.part else 0.0  # wall-clock time, where parts were other calls

        self.add(f"{name}/agent", method, make, answers=answered, steps=steps)

    def strongest(self, name: str) -> Row:
        """Return what a training seed keeps on fresh seeds against what is strongest on tuning seeds.

        With it comes that response, its method, the CPU seconds of it alone, and those until it was found.
        """
        index = min(range(len(self.rows)), key=lambda k: self.rows[k].returns[name])
        row = self.rows[index]
        return {
            **self.target.kept(name, self._place(row.response, row.method), FINAL_MATCHES),
            "response": row.response,
            "method": row.method,
            "seconds": row.seconds,
            "spent": round(sum(each.seconds for each in self.rows[: index + 1]), 1),
        }

    def _game(self, answered: str, **options: Any) -> GameSpec:
        """Return the game of a response to a training seed."""
        return GameSpec.of(self.target.game, reward=self.reward, **{self.target.side: answered, **options})

    def _place(self, response: str, method: str) -> str:
        """Return the name by which a response plays."""
        return response if method == "script" else str(self.folder / response)

    def _answered(self, number: int) -> str:
        """Return the training seed that a response answers: the first one first, then the others in turn."""
        first = self.seeds.index(self.target.agent)
        return self.seeds[(first + number) % len(self.seeds)]
