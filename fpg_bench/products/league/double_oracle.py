"""Double oracle: a side answers responses to it, iteration by iteration.

McMahan, Gordon and Blum, "Planning in the presence of cost functions controlled by an adversary", 2003, with
trained policies as the oracles (PSRO: Lanctot et al., "A unified game-theoretic approach to multiagent
reinforcement learning", 2017). Each side's oracle trains an answer to a mixture of the other side's
population; a meta-solver says to which. It stops on what a fresh response leaves, not on the meta-game's
value: that rises while a new response still breaks every policy.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypedDict

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_json, write_whole
from fpg_bench.common.ids import SCRIPTED, find_env, other_side, policy_env
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.store import RECORDS, Pairing, Store
from fpg_bench.evaluation.suite import Rival, Suite, side_suite
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import expand_suites, member_folder
from fpg_bench.products.league.config import DoubleOracleConfig
from fpg_bench.products.league.evaluation import MATCHES
from fpg_bench.products.league.folder import as_json, check_same, export_agent, search_folder, settings_of
from fpg_bench.products.league.payoffs import Payoffs
from fpg_bench.products.league.targets import RESPONSE_REWARDS
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import check_run, train

ROWS, ABOUT = "search.jsonl", "search.json"
# Iteration k with seed s has training seed 1000 s + k, responses to it 1000 s + 500 + 2 k and the next.
SEED_STRIDE = 1000
FINALISTS = 2  # iterations that a second response is trained against
PARTS = 100  # into which the shares of an equilibrium's players are rounded
_logger = logging.getLogger(__name__)


class SearchResult(TypedDict):
    """Result of a double oracle. All returns are the side's, per step, on tuning seeds.

    ``rows`` has of each iteration ``low``, what is kept against the fresh response, by ``nash`` by the side's
    mixture; ``high``, what the policy earns from the rivals of its training, by their weights, which bounds
    the game's value from above as far as the training found a best answer; ``meta_value``, the value of the
    game between all policies and all rivals so far; and ``seconds``. ``confirmed`` has of the two iterations
    with the highest ``low`` the return of the policy alone against a second response to it, trained
    afterwards with another seed. ``iteration`` is the one that keeps most, which is exported.
    """

    rows: list[Row]
    confirmed: dict[str, float]
    iteration: int


def double_oracle(config: DoubleOracleConfig, out: str | Path, *, progress: bool = True) -> SearchResult:
    """Train a side against responses, and responses against the side.

    An iteration goes on from the weights of the one before; then a fresh response is trained, and both join
    their populations. By the meta-solver ``weights`` the side answers all rivals, each response listed
    ``weight`` times, and the response the side's newest policy alone. By ``nash`` the side answers the other
    side's mixture in the equilibrium of all policies so far, and the response that of the side, the new
    policy included.

    Args:
        config: the search.
        out: its folder. ``search.jsonl`` has a row per iteration, ``search.json`` the settings and the
            result, ``runs`` a run each, ``records.jsonl`` who met whom, and ``agent`` is the exported policy.
            A stopped search is resumed, and a larger number of iterations adds to them.
        progress: show the progress of each training.

    Returns:
        The result.

    Raises:
        UserError: something unknown or out of range, or a folder with another search or other files.
        KeyboardInterrupt: stopped by the user.
    """
    return _DoubleOracle(config, Path(out), progress).run()


class _DoubleOracle:
    """A double oracle in a folder.

    Attributes:
        game: the side's game, against the rivals of its first training.
        response_game: the game of responses to the side.
    """

    def __init__(self, config: DoubleOracleConfig, out: Path, progress: bool) -> None:
        self.config, self.folder, self.progress = config, out, progress
        self.runs = self.folder / "runs"
        self.response_steps = config.response_steps or config.steps
        side, other = config.side, other_side(config.side)
        against = list(SCRIPTED[other]) if config.against is None else config.against
        game = GameSpec.of(policy_env(side).id, against=against, actions=config.actions, **config.game)
        rivals = [member_folder(str(name), other) for name in expand_suites(game.others, other)]
        self.game = GameSpec.of(game, **{other: rivals})
        self.response_game = GameSpec.of(
            policy_env(other).id,
            actions=config.response_actions,
            reward=RESPONSE_REWARDS[side],
            **config.game,
        )

    def rivals(self, iteration: int) -> list[str]:
        """Return the rivals that an iteration answers, by their weights or in parts of the equilibrium."""
        if iteration and self.config.meta_solver == "nash":
            return _in_parts(self.meta_game(iteration, iteration).equilibrium().rivals)
        responses = [str(self.response(before).agent) for before in range(iteration)]
        return [*self.game.others, *(name for name in responses for _ in range(self.config.weight))]

    def answered(self, iteration: int) -> list[str]:
        """Return the policies of the side that an iteration's fresh response answers, by their shares."""
        if self.config.meta_solver == "nash":
            return _in_parts(self.meta_game(iteration + 1, iteration).equilibrium().players)
        return [str(self.policy(iteration).agent)]

    def policy(self, iteration: int) -> RunFolder:
        """Return the folder of the side's run in an iteration."""
        return RunFolder(self.runs / f"iteration_{iteration}")

    def response(self, iteration: int, number: int = 0) -> RunFolder:
        """Return the folder of the run of a response to an iteration: 0 the fresh one, 1 the second."""
        return RunFolder(self.runs / f"response_{iteration}_{number}")

    def side_config(self, iteration: int, rivals: Sequence[str]) -> RunConfig:
        """Return the side's run in an iteration, against these rivals."""
        config = self.config
        return RunConfig(
            config.algorithm,
            GameSpec.of(self.game, **{other_side(config.side): list(rivals)}),
            SEED_STRIDE * config.seed + iteration,
            config.steps,
            config.hyperparams,
            start=self.policy(iteration - 1).path if iteration else None,
            allow=config.allow,
        )

    def response_config(self, game: GameSpec, number: int) -> RunConfig:
        """Return the run of a response; its number decides the training seed."""
        config = self.config
        return RunConfig(
            config.response_algorithm,
            game,
            SEED_STRIDE * config.seed + SEED_STRIDE // 2 + number,
            self.response_steps,
            config.response_hyperparams,
            allow=config.allow,
        )

    def run(self) -> SearchResult:
        """Play the iterations that are missing, confirm the best ones, and export the one that keeps most."""
        check_run(self.side_config(0, self.game.others))
        check_run(self.response_config(self.response_game, 0))
        about, file = self._describe(), RowFile(self.folder / ROWS, {"iteration": int})
        with search_folder(self.folder, ABOUT, ROWS, "search"):
            rows = file.read()
            if not rows:
                write_json(self.folder / ABOUT, about)
            known = check_same(self.folder / ABOUT, "a search", about).get("confirmed", {})
            for iteration in range(len(rows), self.config.iterations):
                if _is_flat(rows, self.config.patience):
                    break
                rows.append(self._play(iteration))
                file.append(rows[-1:])
                _logger.info(_row_text(rows[-1]))
            best = sorted(rows, key=lambda row: row["low"], reverse=True)[:FINALISTS]
            confirmed = {
                iteration: known[iteration] if iteration in known else self._confirm(int(iteration))
                for iteration in (str(row["iteration"]) for row in best)
            }
            result: SearchResult = {
                "rows": rows,
                "confirmed": confirmed,
                "iteration": int(max(confirmed, key=lambda iteration: confirmed[iteration])),
            }
            self._export(result["iteration"])
            write_json(self.folder / ABOUT, {**about, **result})
            return result

    def _describe(self) -> JsonObject:
        """Return the settings that distinguish it from another search, as they are read from JSON."""
        config = self.config
        kinds = (
            ("hyperparams", config.algorithm, self.game),
            ("response_hyperparams", config.response_algorithm, self.response_game),
        )
        hyperparameters = {
            name: load_hyperparameters(algorithm, game, getattr(config, name), allow=config.allow).entry()
            for name, algorithm, game in kinds
        }
        in_games = ("against", "actions", "response_actions")
        about = {
            "verb": config.verb,
            **settings_of(config, "iterations", "patience", *in_games),
            **hyperparameters,
            "response_steps": self.response_steps,
            "game": self.game.to_dict(),
            "response": self.response_game.to_dict(),
            "scenario": self.game.resolve().hash,
        }
        return as_json(about)

    def _play(self, iteration: int) -> Row:
        """Train an iteration and its fresh response; return its row."""
        start = time.monotonic()
        rivals, policy = self.rivals(iteration), self.policy(iteration)
        run = self.side_config(iteration, rivals)
        train(run, policy.path, evaluations=0, progress=self.progress, resume=True)
        low = self.answer(iteration, self.answered(iteration))
        meta_game = self.meta_game(iteration + 1, iteration + 1)
        return {
            "iteration": iteration,
            "low": low,
            "high": round(meta_game.interval(str(policy.agent), shares(rivals)).value, 4),
            "meta_value": round(meta_game.equilibrium().value, 4),
            "rivals": len(rivals),
            "seconds": round(time.monotonic() - start, 1),
        }

    def _confirm(self, iteration: int) -> float:
        """Return what an iteration's policy alone keeps against a second response to it."""
        return self.answer(iteration, [str(self.policy(iteration).agent)], number=1)

    def answer(self, iteration: int, policies: Sequence[str], number: int = 0) -> float:
        """Train a response to policies of the side, and return what their mixture keeps against it."""
        run, mixture = self.response(iteration, number), shares(policies)
        game = GameSpec.of(self.response_game, against=list(policies))
        config = self.response_config(game, 2 * iteration + number)
        train(config, run.path, evaluations=0, progress=self.progress, resume=True)
        payoffs = self.payoffs(list(mixture), [str(run.agent)])
        kept = sum(share * payoffs.interval(name, str(run.agent)).value for name, share in mixture.items())
        return round(float(kept), 4)

    def meta_game(self, policies: int, responses: int) -> Payoffs:
        """Return the game of so many policies against the first rivals and so many responses."""
        agents = [str(self.policy(number).agent) for number in range(policies)]
        found = [str(self.response(number).agent) for number in range(responses)]
        return self.payoffs(agents, list(dict.fromkeys([*self.game.others, *found])))

    def payoffs(self, agents: Sequence[str], rivals: Sequence[str]) -> Payoffs:
        """Return what agents of the side earn from rivals; only pairings without a record are played.

        In records, and in the hashes of their suites, the search's own agents are named within its folder.
        """
        side, scenario = self.config.side, self.game.resolve()
        scale = side_suite(side, scenario).scale
        suites = [
            Suite("league", side, scenario, MATCHES, (Rival(self._within(rival), (rival,), scenario),), scale)
            for rival in rivals
        ]
        wanted = [
            Pairing(player_entry(agent, self._within(agent)), suite, suite.rivals[0])
            for agent in agents
            for suite in suites
        ]
        store = Store(self.folder / RECORDS)
        store.fill(wanted, partial(play, seeds=tuning_seeds))
        payoffs = Payoffs.of(store, wanted)
        return dataclasses.replace(payoffs, players=tuple(agents), rivals=tuple(rivals))

    def _within(self, name: str) -> str:
        """Return a player's name, an agent's of the search relative to the folder."""
        path = Path(name)
        return path.relative_to(self.folder).as_posix() if path.is_relative_to(self.folder) else name

    def _export(self, iteration: int) -> None:
        """Export the agent of an iteration; ``agent.json`` describes the whole search up to it."""
        runs = [self.policy(number) for number in range(iteration + 1)]
        export_agent(runs, self.folder, "agent", {"training_seed": self.config.seed})


def search_rows(folder: Path) -> list[Row]:
    """Return the rows of a finished search, each with the search's settings and what its policy kept later.

    Raises:
        UserError: the folder holds no finished search.
    """
    result = read_json(folder / ABOUT, "search")
    if "confirmed" not in result:
        raise UserError(f"{folder}: the search is not finished; run its command again")
    settings: Row = {
        "scenario": result["game"].get("scenario", "standard"),
        "side": find_env(result["game"]["id"]).side,
        **{name: result[name] for name in ("verb", "meta_solver")},
        "actions": result["game"].get("actions", "continuous"),
        **{name: result[name] for name in ("seed", "steps", "response_steps")},
    }
    confirmed = result["confirmed"]
    return [{**settings, **row, "confirmed": confirmed.get(str(row["iteration"]))} for row in result["rows"]]


def keep_search(folder: Path, file: Path, search: str | None = None) -> None:
    """Put the rows of a finished search into a file, in the place of those of its name and seed.

    Args:
        folder: the search's folder.
        file: a file of rows, which need not exist.
        search: the search's name, in a file of several.

    Raises:
        UserError: the search is not finished, or the file cannot be read.
    """
    named: Row = {} if search is None else {"search": search}
    rows = [named | row for row in search_rows(folder)]
    key = search, rows[0]["seed"]
    others = [
        row
        for row in RowFile(file, {"seed": int, "iteration": int}).read()
        if (row.get("search"), row["seed"]) != key
    ]
    rows = sorted([*others, *rows], key=lambda row: (row.get("search", ""), row["seed"], row["iteration"]))
    write_whole(file, "".join(json.dumps(row) + "\n" for row in rows))


def shares(names: Sequence[str]) -> dict[str, float]:
    """Return the share of each name in a list that names some several times."""
    return {name: names.count(name) / len(names) for name in dict.fromkeys(names)}


def _in_parts(mixture: Mapping[str, float]) -> list[str]:
    """Return a list that names each player by its share, in parts of all: those with the largest rest first.

    >>> _in_parts({"tone": 0.4951, "comb": 0.5, "sweep": 0.0049}).count("tone")
    50
    """
    parts = {name: int(PARTS * share) for name, share in mixture.items()}
    by_rest = sorted(mixture, key=lambda name: parts[name] - PARTS * mixture[name])
    for name in by_rest[: PARTS - sum(parts.values())]:
        parts[name] += 1
    return [name for name, count in parts.items() for _ in range(count)]


def _is_flat(rows: Sequence[Row], patience: int) -> bool:
    """Return True if the last iterations brought no higher ``low`` than those before them."""
    lows = [row["low"] for row in rows]
    return len(lows) > patience and max(lows[-patience:]) <= max(lows[:-patience])


def _row_text(row: Row) -> str:
    """Return a log line for an iteration's row."""
    return (
        f"iteration {row['iteration']}: low {row['low']:.2f}, high {row['high']:.2f}, meta-value "
        f"{row['meta_value']:.2f} per step; {row['seconds']:.0f} s"
    )
