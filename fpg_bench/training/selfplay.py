"""Self-play: both sides in turns, each generation a best response to past generations of the other side.

Fictitious self-play (Heinrich, Lanctot and Silver, "Fictitious self-play in extensive-form games", 2015)
with the pool of past policies in the place of their average.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.checks import whole
from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.files import read_json, write_json, write_whole
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.ids import policy_view
from fpg_bench.players.player import SIDES
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import Row, RowFile
from fpg_bench.training.encounters import met, told
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder, command_line
from fpg_bench.training.spec import RunSpec
from fpg_bench.training.train import train_run

GENERATIONS, STEPS, POOL = 10, 500_000, 5
ROWS, ABOUT = "selfplay.jsonl", "selfplay.json"
SEED_STRIDE = 1000  # generation g of seed k has training seed 1000 k + g: matches of its own


def selfplay(
    algorithm: str,
    out: str | Path,
    *,
    generations: int = GENERATIONS,
    evaluations: int = 1,
    progress: bool = True,
    say: Callable[[str], None] = print,
    **words: Any,
) -> dict[str, Path]:
    """Train both sides against each other's past, generation by generation.

    Generation 0 of a side plays all scripts of the other; each later one goes on from the weights of the one
    before, against some past generations of the other side. Every generation is a run of its own. What was
    stopped goes on, more generations go on from those that are there, and what is done is not done again.

    Args:
        algorithm: what trains each side; see :func:`fpg_bench.training.train.train`.
        out: a folder: ``generations/<side>_<g>``, a run's folder each; ``selfplay.jsonl``, a row each;
            ``ally`` and ``opponent``, the agents of the last generation.
        generations: how many, of each side.
        evaluations: how often each generation is scored on its field on the way, besides its start; 0: never.
        progress: whether to show how training goes.
        say: told a line per row.
        **words: the others of :class:`Selfplay` (``steps``, ``pool``, ``seed``, ``hyperparams``), and the
            game: ``scenario``, ``path``, ``knowledge``, ``jamming_types``, as for
            :class:`fpg_bench.envs.core.OneSided`.

    Returns:
        The folders of both agents.

    Raises:
        UserError: something unknown or out of range, a folder with another self-play, or an agent of a past
            generation that is not whole.
        KeyboardInterrupt: stopped by the user.
    """
    own = {name: words.pop(name) for name in ("steps", "pool", "seed", "hyperparams") if name in words}
    options = {name: value for name, value in words.items() if value is not None}
    made = Selfplay(algorithm, Path(out), **own, options=options)
    for name, value in (("generations", generations), ("pool", made.pool)):
        whole(value, name)
    about, file = made.described(), RowFile(made.folder / ROWS, {"generation": int, "side": str})
    with file.locked():
        done = {(row["generation"], row["side"]) for row in file.read()}
        made.claim(about, begun=bool(done))
        for generation in range(generations):
            for side in SIDES:
                if (generation, side) not in done:
                    made.learn(side, generation, evaluations, progress)
                    file.append([row := made.row(side, generation)])
                    say(_line(row))
        last = {row["side"]: row["generation"] for row in file.read()}
        return {side: made.ship(side, last[side] + 1) for side in SIDES}


@dataclass(frozen=True)
class Selfplay:
    """What is trained, and where.

    Attributes:
        algorithm, folder: see :func:`selfplay`.
        steps: the budget of a generation of a side.
        pool: at most so many past generations of the other side, drawn anew for each.
        seed: decides the draws and the matches.
        hyperparams: as for :class:`fpg_bench.training.spec.RunSpec`; ids of both sides stand in the file.
        options: the game.
    """

    algorithm: str
    folder: Path
    steps: int = STEPS
    pool: int = POOL
    seed: int = 0
    hyperparams: str | Path | Mapping[str, Any] | None = None
    options: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def scenario(self) -> Scenario:
        """What is played."""
        changes = dict(self.options)
        return as_scenario(changes.pop("scenario", None), opponent_path=changes.pop("path", None), **changes)

    def described(self) -> dict[str, Any]:
        """What tells it apart from another, as it is read again."""
        parameters = {
            side: load_hyperparameters(
                self.algorithm, policy_view(side).id, self.hyperparams, path=self.options.get("path")
            )
            for side in SIDES
        }
        about = {
            "algorithm": self.algorithm,
            "scenario": self.scenario.hash,
            "steps": self.steps,
            "pool": self.pool,
            "seed": self.seed,
            "hyperparameters": {side: dataclasses.asdict(found) for side, found in parameters.items()},
        }
        content: dict[str, Any] = json.loads(json.dumps(about))
        return content

    def claim(self, about: dict[str, Any], begun: bool) -> None:
        """Say in the folder whose it is; raise UserError where it holds generations of another."""
        file = self.folder / ABOUT
        if not begun:
            write_json(file, about)
        found = read_json(file, "self-play")
        if different := [key for key in about if found.get(key) != about[key]]:
            raise UserError(
                f"{self.folder}: holds a self-play with another {different[0]}; choose another folder"
            )

    def run(self, side: str, generation: int) -> RunFolder:
        """The run of a generation of a side."""
        return RunFolder(self.folder / "generations" / f"{side}_{generation}")

    def others(self, side: str, generation: int) -> dict[str, str]:
        """Whom a generation of a side is trained against, by the names that rows tell them by."""
        other = SIDES[1 - SIDES.index(side)]
        if generation == 0:
            return {name: name for name in SCRIPTED[other]}
        drawn = draw_past(side, generation, self.pool, self.seed)
        return {f"{other}_{past}": str(self.run(other, past).agent) for past in drawn}

    def learn(self, side: str, generation: int, evaluations: int, progress: bool) -> None:
        """Train a generation of a side, or go on with it."""
        run = RunSpec(
            self.algorithm,
            policy_view(side).id,
            SEED_STRIDE * self.seed + generation,
            self.steps,
            self.hyperparams,
            against=list(self.others(side, generation).values()),
            start=self.run(side, generation - 1).path if generation else None,
            options=self.options,
        )
        where = self.run(side, generation).path
        train_run(run, where, evaluations=evaluations, progress=progress, resume=True)

    def row(self, side: str, generation: int) -> Row:
        """What a generation of a side scored: on its field, and against those it was trained against."""
        run, others = self.run(side, generation), self.others(side, generation)
        about, looks = read_json(run.path / "run.json", "run"), run.evaluations.read()
        head = {
            "generation": generation,
            "side": side,
            "steps": about["steps_done"],
            "against": list(others),
            "field": about["field"],
            "field_score": looks[-1]["score"] if looks else None,
        }
        return head | told(met(str(run.agent), others, side, self.scenario, seeds=tuning_seeds))

    def ship(self, side: str, generations: int) -> Path:
        """Copy the last generation's agent, which then says how all of it was made."""
        folder, last = self.folder / side, self.run(side, generations - 1).agent
        parts = [read_json(self.run(side, g).path / "run.json", "run") for g in range(generations)]
        about = read_json(last / "agent.json", "agent")
        settings = {"generations": generations, "steps": self.steps, "pool": self.pool, "seed": self.seed}
        about |= {
            "command": command_line("selfplay", self.algorithm, **settings, **self.options),
            "options": {name: about["options"][name] for name in self.options},
            "training_seed": self.seed,
            "training_steps": generations * self.steps,
            **{key: round(sum(part[key] for part in parts), 1) for key in ("steps_done", "seconds")},
        }
        write_whole(folder / "policy.onnx", (last / "policy.onnx").read_bytes())
        write_json(folder / "agent.json", about)
        return folder


def draw_past(side: str, generation: int, pool: int, seed: int) -> list[int]:
    """Which generations of the other side one of this side is trained against: any before it, evenly."""
    rng = np.random.default_rng([seed, generation, SIDES.index(side)])
    return sorted(rng.choice(generation, min(pool, generation), replace=False).tolist())


def _line(row: Row) -> str:
    """A row in words."""
    found = row["measures"]
    kinds = ", ".join(f"{kind} {100 * found[f'share_{kind}']:.0f} %" for kind in JAMMING_TYPES)
    on_field = "" if row["field_score"] is None else f", {row['field_score']:.1f} on {row['field']}"
    return (
        f"{row['side']}_{row['generation']}: {row['score']:.1f} against {', '.join(row['against'])}{on_field}"
        f"; hops {100 * found['hop_rate']:.0f} %, spreading {100 * found['spread_ratio']:.0f} %, {kinds}"
    )
