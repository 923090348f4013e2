"""Fictitious self-play: both sides learn against past generations of each other.

Heinrich, Lanctot and Silver, "Fictitious self-play in extensive-form games", 2015, with a pool of past
policies in the place of their average.
"""

from __future__ import annotations

import logging
from itertools import product
from pathlib import Path

import numpy as np

from fpg_bench.common.files import write_json
from fpg_bench.common.ids import SCRIPTED, other_side, policy_env
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import SIDES
from fpg_bench.products.league.config import FictitiousSelfPlayConfig
from fpg_bench.products.league.evaluation import MATCHES, evaluate_against, result_row
from fpg_bench.products.league.folder import (
    as_json,
    check_same,
    command_of,
    export_agent,
    search_folder,
    settings_of,
)
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import check_run, train

ROWS, ABOUT = "generations.jsonl", "fictitious_self_play.json"
SEED_STRIDE = 1000  # generation g of self-play with seed k has training seed 1000 k + g
_logger = logging.getLogger(__name__)


def fictitious_self_play(
    config: FictitiousSelfPlayConfig, out: str | Path, *, progress: bool = True
) -> dict[str, Path]:
    """Train both sides alternately, each generation against past generations of the other side.

    Generation 0 of a side plays all scripts of the other side. Each later generation starts from the weights
    of the one before. Every generation is a separate run. A stopped call is resumed: finished generations are
    not trained again, and a larger number adds generations to them.

    Args:
        config: the self-play; its seed is also the ``training_seed`` of the exported agents.
        out: a folder for ``generations/<side>_<g>``, the runs; ``generations.jsonl``, one row per generation;
            ``fictitious_self_play.json``, the settings; ``ally`` and ``opponent``, the agents of the last
            generation.
        progress: show the progress of each training.

    Returns:
        The folders of both agents.

    Raises:
        UserError: something unknown or out of range, a folder with another self-play or other files, or an
            agent of a past generation that is incomplete.
        KeyboardInterrupt: stopped by the user.
    """
    league = _FictitiousSelfPlay(config, Path(out))
    for side in SIDES:
        check_run(league.run_config(side, 0))
    about, file = league.describe(), RowFile(league.folder / ROWS, {"generation": int, "side": str})
    with search_folder(league.folder, ABOUT, ROWS, "fictitious self-play"):
        done = {(row["generation"], row["side"]) for row in file.read()}
        if not done:
            write_json(league.folder / ABOUT, about)
        check_same(league.folder / ABOUT, "a fictitious self-play", about)
        for generation, side in product(range(config.generations), SIDES):
            if (generation, side) not in done:
                run, folder = league.run_config(side, generation), league.run(side, generation).path
                train(run, folder, evaluations=config.n_evals, progress=progress, resume=True)
                row = league.evaluate(side, generation)
                file.append([row])
                _logger.info(_row_text(row))
        last = {row["side"]: row["generation"] for row in file.read()}
        return {side: league.export(side, last[side] + 1) for side in SIDES}


class _FictitiousSelfPlay:
    """A fictitious self-play in a folder."""

    def __init__(self, config: FictitiousSelfPlayConfig, folder: Path) -> None:
        self.config, self.folder = config, folder
        self.games = {side: GameSpec.of(policy_env(side).id, **config.game) for side in SIDES}

    def describe(self) -> JsonObject:
        """Return the settings that distinguish it from another self-play, as they are read from JSON."""
        config = self.config
        return as_json(
            settings_of(config, "generations", "n_evals")
            | {
                "scenario": self.games["ally"].resolve().hash,
                "hyperparams": {
                    side: load_hyperparameters(
                        config.algorithm, game, config.hyperparams, allow=config.allow
                    ).entry()
                    for side, game in self.games.items()
                },
            }
        )

    def run(self, side: str, generation: int) -> RunFolder:
        """Return the folder of a generation's run."""
        return RunFolder(self.folder / "generations" / f"{side}_{generation}")

    def others(self, side: str, generation: int) -> dict[str, str]:
        """Return the players that a generation is trained against, by their names in rows."""
        other = other_side(side)
        if generation == 0:
            return {name: name for name in SCRIPTED[other]}
        past = draw_past(side, generation, self.config.pool, self.config.seed)
        return {f"{other}_{number}": str(self.run(other, number).agent) for number in past}

    def run_config(self, side: str, generation: int) -> RunConfig:
        """Return the run of a generation."""
        config = self.config
        return RunConfig(
            config.algorithm,
            GameSpec.of(self.games[side], against=list(self.others(side, generation).values())),
            SEED_STRIDE * config.seed + generation,
            config.steps,
            config.hyperparams,
            start=self.run(side, generation - 1).path if generation else None,
            allow=config.allow,
        )

    def evaluate(self, side: str, generation: int) -> Row:
        """Return a generation's row: its scores on the suite, and against the players of its training."""
        run, others = self.run(side, generation), self.others(side, generation)
        about, scores = run.read(), run.last_scores()
        head = {
            "generation": generation,
            "side": side,
            "steps": about.steps_done,
            "against": list(others),
            "suite": about.suite,
            "suite_score": scores.get(side),
        }
        scenario = self.games[side].resolve()
        summary = evaluate_against(str(run.agent), others, side, scenario, MATCHES, tuning_seeds)
        return head | result_row(summary)

    def export(self, side: str, generations: int) -> Path:
        """Export the agent of the last generation; ``agent.json`` describes the whole self-play."""
        config, game = self.config, self.games[side]
        runs = [self.run(side, generation) for generation in range(generations)]
        command = command_of(config, game, self.folder, generations=generations)
        update: JsonObject = {"command": command, "training_seed": config.seed, "game": game, "options": {}}
        return export_agent(runs, self.folder, side, update)


def draw_past(side: str, generation: int, pool: int, seed: int) -> list[int]:
    """Draw uniformly the past generations of the other side that a generation is trained against."""
    rng = np.random.default_rng([seed, generation, SIDES.index(side)])
    return sorted(rng.choice(generation, min(pool, generation), replace=False).tolist())


def _row_text(row: Row) -> str:
    """Return a log line for a generation's row."""
    measures = row["measures"]
    shares = ", ".join(f"{kind} {100 * measures[f'share_{kind}']:.0f} %" for kind in JAMMING_TYPES)
    on_suite = "" if row["suite_score"] is None else f", {row['suite_score']:.1f} on {row['suite']}"
    return (
        f"{row['side']}_{row['generation']}: {row['score']:.1f} against {', '.join(row['against'])}{on_suite}"
        f"; hops {100 * measures['hop_rate']:.0f} %, spreading {100 * measures['spread_ratio']:.0f} %, "
        f"{shares}"
    )
