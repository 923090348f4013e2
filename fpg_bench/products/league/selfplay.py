"""Self-play of both sides against past generations of each other.

Fictitious self-play (Heinrich, Lanctot and Silver, "Fictitious self-play in extensive-form games", 2015) with
a pool of past policies in the place of their average.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.checks import integer
from fpg_bench.common.files import check_own_folder, write_json
from fpg_bench.common.ids import SCRIPTED, other_side, policy_env
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import read_card
from fpg_bench.players.player import SIDES
from fpg_bench.products.league.evaluation import MATCHES, check_same, evaluate_against, result_row
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import Hyperparams, as_option, load_hyperparameters
from fpg_bench.training.run_folder import RunFolder, command_line
from fpg_bench.training.train import check_run, train

ROWS, ABOUT = "selfplay.jsonl", "selfplay.json"
SEED_STRIDE = 1000  # generation g of self-play with seed k has training seed 1000 k + g
_logger = logging.getLogger(__name__)


def selfplay(
    algorithm: str,
    out: str | Path,
    *,
    generations: int = 10,
    steps: int = 500_000,
    pool: int = 5,
    seed: int = 0,
    hyperparams: Hyperparams = None,
    evaluations: int = 1,
    progress: bool = True,
    allow: Collection[str] = (),
    **game: Any,
) -> dict[str, Path]:
    """Train both sides alternately, each generation against past generations of the other side.

    Generation 0 of a side plays all scripts of the other side. Each later generation starts from the weights
    of the one before. Every generation is a separate run. A stopped call is resumed: finished generations are
    not trained again, and a larger number adds generations to them.

    Args:
        algorithm: algorithm of both sides; see :class:`fpg_bench.training.config.RunConfig`.
        out: a folder for ``generations/<side>_<g>``, the runs; ``selfplay.jsonl``, one row per generation;
            ``ally`` and ``opponent``, the agents of the last generation.
        generations: number of generations of each side.
        steps: training budget of one generation of one side.
        pool: maximum number of past generations of the other side that are drawn for a generation.
        seed: decides the draws and the training seeds, ``1000 * seed + g`` for generation g; it is also the
            ``training_seed`` of the exported agents.
        hyperparams: a YAML file, or an entry for the ids of both sides; None takes the shipped file.
        evaluations: number of evaluations of each generation on its suite, besides the one at its start; 0
            for none.
        progress: show the progress of each training.
        allow: the ``package.module:object`` and agents of the Hub that the file of the hyper-parameters may
            name; neither is run on a file's word.
        **game: attributes of :class:`fpg_bench.game.spec.GameSpec` that both sides share, ``scenario`` and
            ``path`` for instance.

    Returns:
        The folders of both agents.

    Raises:
        UserError: something unknown or out of range, a folder with another self-play or other files, or an
            agent of a past generation that is incomplete.
        KeyboardInterrupt: stopped by the user.
    """
    for name, value in (("generations", generations), ("pool", pool)):
        integer(value, name)
    games = {side: GameSpec.of(policy_env(side).id, **game) for side in SIDES}
    league = _SelfPlay(algorithm, Path(out), steps, pool, seed, hyperparams, games, allow, evaluations)
    for side in SIDES:
        check_run(league.run_config(side, 0))
    about, file = league.describe(), RowFile(league.folder / ROWS, {"generation": int, "side": str})
    check_own_folder(league.folder, ABOUT, "self-play", ROWS)
    with file.locked():
        done = {(row["generation"], row["side"]) for row in file.read()}
        if not done:
            write_json(league.folder / ABOUT, about)
        check_same(league.folder / ABOUT, "a self-play", about)
        for generation, side in product(range(generations), SIDES):
            if (generation, side) not in done:
                run = league.run_config(side, generation)
                folder = league.run(side, generation).path
                train(run, folder, evaluations=evaluations, progress=progress, resume=True)
                row = league.evaluate(side, generation)
                file.append([row])
                _logger.info(_row_text(row))
        last = {row["side"]: row["generation"] for row in file.read()}
        return {side: league.export_agent(side, last[side] + 1) for side in SIDES}


@dataclass(frozen=True)
class _SelfPlay:
    """A self-play league in a folder; its attributes are arguments of :func:`selfplay`."""

    algorithm: str
    folder: Path
    steps: int
    pool: int
    seed: int
    hyperparams: Hyperparams
    games: Mapping[str, GameSpec]
    allow: Collection[str]
    evaluations: int

    def describe(self) -> JsonObject:
        """Return the settings that distinguish it from another self-play, as they are read from JSON."""
        parameters = {
            side: load_hyperparameters(self.algorithm, self.games[side], self.hyperparams, allow=self.allow)
            for side in SIDES
        }
        about = {
            "algorithm": self.algorithm,
            "scenario": self.games["ally"].resolve().hash,
            "steps": self.steps,
            "pool": self.pool,
            "seed": self.seed,
            "hyperparameters": {side: each.entry() for side, each in parameters.items()},
        }
        content: JsonObject = json.loads(json.dumps(about))
        return content

    def run(self, side: str, generation: int) -> RunFolder:
        """Return the folder of a generation's run."""
        return RunFolder(self.folder / "generations" / f"{side}_{generation}")

    def others(self, side: str, generation: int) -> dict[str, str]:
        """Return the players that a generation is trained against, by their names in rows."""
        other = other_side(side)
        if generation == 0:
            return {name: name for name in SCRIPTED[other]}
        past = draw_past(side, generation, self.pool, self.seed)
        return {f"{other}_{number}": str(self.run(other, number).agent) for number in past}

    def run_config(self, side: str, generation: int) -> RunConfig:
        """Return the run of a generation."""
        return RunConfig(
            self.algorithm,
            GameSpec.of(self.games[side], against=list(self.others(side, generation).values())),
            SEED_STRIDE * self.seed + generation,
            self.steps,
            self.hyperparams,
            start=self.run(side, generation - 1).path if generation else None,
            allow=self.allow,
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

    def export_agent(self, side: str, generations: int) -> Path:
        """Copy the agent of the last generation; its ``agent.json`` describes the whole self-play."""
        last = self.run(side, generations - 1).agent
        game = self.games[side]
        shared = game.to_dict()
        del shared["id"]
        options = {
            "generations": generations,
            "steps": self.steps,
            "pool": self.pool,
            "seed": self.seed,
            "hyperparams": as_option(self.hyperparams),
            **shared,
            "n_evals": self.evaluations,
        }
        update: JsonObject = {
            "command": command_line("selfplay", self.algorithm, out=self.folder, allow=self.allow, **options),
            "game": game,
            "options": {},
            "training_seed": self.seed,
            "training_steps": generations * self.steps,
        }
        card = read_card(last).model_copy(update=update)
        card.write(self.folder / side, (last / "policy.onnx").read_bytes())
        return self.folder / side


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
