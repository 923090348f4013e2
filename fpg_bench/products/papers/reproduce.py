"""Reproduction of a published result: run its experiments, and write rows, a figure and a page."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from importlib.metadata import version
from itertools import product
from pathlib import Path
from types import MappingProxyType

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_writable
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.products.papers.page import write_page
from fpg_bench.products.papers.reproduction import Paper, PaperResults
from fpg_bench.version import __version__

# Length of the training as a share of the paper's, and the default number of seeds
BUDGETS: Mapping[str, tuple[float, int]] = MappingProxyType({"quick": (0.02, 2), "full": (1.0, 5)})


def reproduce(
    paper: Paper,
    out: str | Path = "reproduced",
    *,
    budget: str = "quick",
    n_seeds: int | None = None,
    first_seed: int = 0,
    workers: Workers | int = 1,
) -> list[Path]:
    """Train all players of a paper under all its conditions, and write rows, a figure and a page.

    Rows are kept as they finish, and a second call continues with the missing ones.

    Args:
        paper: the paper.
        out: folder of the files.
        budget: ``quick`` or ``full``.
        n_seeds: number of training seeds. None: the default of the budget.
        first_seed: first training seed.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The files written.

    Raises:
        UserError: an unknown budget, or failed runs (the others are kept).
    """
    if budget not in BUDGETS:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, BUDGETS)}")
    out, (share, default) = Path(out), BUDGETS[budget]
    check_writable(out)
    count = integer(default if n_seeds is None else n_seeds, "n_seeds")
    seeds = range(first_seed, first_seed + count)
    file = RowFile(out / f"{paper.facts.name}-{budget}.jsonl", {"player": str, "condition": str, "seed": int})
    with file.locked():
        stored = _read(file)
        jobs = [
            Job(
                f"{paper.facts.name} {player} {condition} seed {seed}",
                partial(run, paper, player, condition, seed, share),
                lambda row: file.append([row]),
            )
            for seed, condition, player in product(seeds, paper.conditions, paper.players)
            if (player, condition, seed) not in stored
        ]
        failed = run_jobs(jobs, workers)
        rows = {key: row for key, row in _read(file).items() if key[2] in seeds}
        command = f"fpg-bench reproduce {paper.facts.name} --budget {budget} --n-seeds {count}"
        command += f" --first-seed {first_seed}" if first_seed else ""
        written = write_page(
            paper, PaperResults(rows), share, command, out / f"{paper.facts.name}-{budget}.md"
        )
        check_all_done(failed)
        return [file.path, *written]


def run(paper: Paper, player: str, condition: str, seed: int, share: float) -> Row:
    """Train and measure one player under one condition."""
    start = time.monotonic()
    measures = paper.play(player, condition, seed, share)
    libraries = (f"{name} {version(name)}" for name in ("stable-baselines3", "torch", "gymnasium", "numpy"))
    return {
        "player": player,
        "condition": condition,
        "seed": seed,
        **measures,
        "seconds": round(time.monotonic() - start, 1),
        "versions": ", ".join([f"fpg-bench {__version__}", *libraries]),
    }


def _read(file: RowFile) -> dict[tuple[str, str, int], Row]:
    return {(row["player"], row["condition"], row["seed"]): row for row in file.read()}
