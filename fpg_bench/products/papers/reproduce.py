"""Reproduction of a published result: run the missing experiments, and report on all of them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_writable
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.products.papers.page import write_page
from fpg_bench.products.papers.reproduction import Paper, PaperResults, versions

if TYPE_CHECKING:
    from fpg_bench.products.papers.yang_2026.study import DuelStudy


def reproduce(
    study: GameStudy | DuelStudy,
    out: str | Path = "reproduced",
    *,
    budget: str = "quick",
    n_seeds: int | None = None,
    first_seed: int = 0,
    workers: Workers | int = 1,
) -> list[Path]:
    """Run a paper's experiments, draw its figures and report its claims.

    Finished runs are kept, and a second call continues with the missing ones.

    Args:
        study: the experiments.
        out: folder of the files.
        budget: ``quick`` or ``full``; a study may have others.
        n_seeds: number of training seeds. None: the default of the budget.
        first_seed: first training seed. Confirming a finding requires seeds that were not used to find it.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The files written.

    Raises:
        UserError: an unknown budget, or failed runs (the others are kept).
    """
    if budget not in study.seeds:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, study.seeds)}")
    out = Path(out)
    check_writable(out)
    count = integer(study.seeds[budget] if n_seeds is None else n_seeds, "n_seeds")
    seeds = range(first_seed, first_seed + count)
    command = f"fpg-bench reproduce {study.arguments} --budget {budget} --n-seeds {count}"
    command += f" --first-seed {first_seed}" if first_seed else ""
    with locked(study.file(out, budget)):
        failed = run_jobs(study.missing(out, budget, seeds), workers)
        written = study.report(out, budget, seeds, command)
        check_all_done(failed)
        return written


# Length of the training as a share of the paper's, and the default number of seeds
BUDGETS: Mapping[str, tuple[float, int]] = MappingProxyType({"quick": (0.02, 2), "full": (1.0, 10)})
_LIBRARIES = ("stable-baselines3", "torch", "gymnasium", "numpy")


@dataclass(frozen=True)
class GameStudy:
    """All players of a paper under all its conditions, in the paper's own game.

    Attributes:
        paper: the paper.
    """

    paper: Paper

    @property
    def arguments(self) -> str:
        """Return the paper's name."""
        return self.paper.facts.name

    @property
    def seeds(self) -> Mapping[str, int]:
        """Return the default number of training seeds by the name of a budget."""
        return {name: seeds for name, (_, seeds) in BUDGETS.items()}

    def file(self, out: Path, budget: str) -> Path:
        """Return the file of rows."""
        return out / f"{self.arguments}-{budget}.jsonl"

    def missing(self, out: Path, budget: str, seeds: range) -> list[Job]:
        """Return a job for each row that the file lacks; the job adds it."""
        file, share = self.file(out, budget), BUDGETS[budget][0]
        stored = read_rows(file)
        return [
            Job(
                f"{self.arguments} {player} {condition} seed {seed}",
                partial(run, self.paper, player, condition, seed, share),
                lambda row: RowFile(file).append([row]),
            )
            for seed, condition, player in product(seeds, self.paper.conditions, self.paper.players)
            if (player, condition, seed) not in stored
        ]

    def report(self, out: Path, budget: str, seeds: range, command: str) -> list[Path]:
        """Write the page and its figures, and return them after the file of rows."""
        file = self.file(out, budget)
        results = PaperResults({key: row for key, row in read_rows(file).items() if key[2] in seeds})
        return [file, *write_page(self.paper, results, BUDGETS[budget][0], command, file.with_suffix(".md"))]


def run(paper: Paper, player: str, condition: str, seed: int, share: float) -> Row:
    """Train and measure one player under one condition."""
    start = time.monotonic()
    measures = paper.play(player, condition, seed, share)
    return {
        "player": player,
        "condition": condition,
        "seed": seed,
        **measures,
        "seconds": round(time.monotonic() - start, 1),
        "versions": versions(*_LIBRARIES),
    }


def read_rows(file: Path) -> dict[tuple[str, str, int], Row]:
    """Return the rows of a file by player, condition and seed; raises UserError for a malformed one."""
    rows = RowFile(file, {"player": str, "condition": str, "seed": int}).read()
    return {(row["player"], row["condition"], row["seed"]): row for row in rows}
