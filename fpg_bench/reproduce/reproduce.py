"""The paper's experiments from the runs to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.files import write_whole
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.reproduce.conditions import LLM, LONG, SHORT_SEEDS, Condition, conditions_of
from fpg_bench.reproduce.experiment import BUDGETS, Budget, run_experiment
from fpg_bench.reproduce.figures import draw
from fpg_bench.reproduce.report import write_report
from fpg_bench.reproduce.results import read_results, run_file
from fpg_bench.reproduce.windows import read_windows
from fpg_bench.training.maddpg_seeds import find_learner


def reproduce(
    target: str = "all",
    out: str | Path = "reproduced",
    *,
    scenario: str = "paper",
    seeds: int | None = None,
    budget: str | Budget = "quick",
    jobs: int = 2,
    backend: str = "loky",
    address: str | None = None,
    llm: Mapping[str, Any] | None = None,
    learner: str = "torch",
    say: Callable[[str], None] = print,
) -> list[Path]:
    """Run what a figure of the paper needs, draw it, and write the report of all runs that are there.

    Args:
        target: ``fig3`` to ``fig7``, ``tables`` or ``all``.
        out: the folder of rows, figures and reports; runs that are there already are not repeated.
        scenario: ``paper`` or ``standard``.
        seeds: runs of each condition that a claim rests on (others: five at most); None: the budget's own.
        budget: ``quick``, ``full``, ``tenth``, ``paper``, or one of one's own.
        jobs, backend, address: how many runs at once, and where; see :func:`fpg_bench.jobs.run.run_jobs`.
        llm: run the language model that the environment names as one more planner, with these options of
            its planner; ``transcript``: replay that file. None: it is not run, and the report says so.
        learner: who updates the networks, ``torch`` or ``jax``, which takes less time and needs the
            extra ``fast``.
        say: told a line per run that begins or ends.

    Returns:
        The files written: figures, then the report.

    Raises:
        UserError: something unknown, or runs that failed (the others are kept).
    """
    budget = _budget(budget)
    find_learner(learner)
    count = budget.seeds if seeds is None else seeds
    if count < 1:
        raise UserError(f"seeds: expected a whole number above 0, got {count}")
    out = Path(out)
    wanted = {c.name: (c, _seeds(c, count)) for c in _conditions(target, scenario, budget, llm)}
    listed = [
        _job(condition, scenario, budget, seeds_of, out, llm, learner)
        for condition, seeds_of in wanted.values()
    ]
    failed = run_jobs(listed, jobs, backend, address, say)
    every = {c.name: range(count) for c in _conditions("all", scenario, BUDGETS["full"], {})}
    results = read_results(out, scenario, budget.name, every)
    figures = draw(results, scenario, out / "figures")
    words = f"fpg-bench reproduce {target} --scenario {scenario} --budget {budget.name} --seeds {count}"
    reports = write_report(results, scenario, budget, figures, out, words)
    check_all_done(failed)
    return [*(path for paths in figures.values() for path in paths), *reports]


def _budget(budget: str | Budget) -> Budget:
    if isinstance(budget, Budget):
        return budget
    if budget not in BUDGETS:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, BUDGETS)}")
    return BUDGETS[budget]


def _conditions(target: str, scenario: str, budget: Budget, llm: Mapping[str, Any] | None) -> list[Condition]:
    found = conditions_of(target, scenario, budget.name == "full")
    if llm is not None and target in ("all", "fig3"):
        found.append(Condition(LLM, "path planned by a language model", {"planner": "llm"}))
    return found


def _seeds(condition: Condition, count: int) -> range:
    """Claims need all seeds, pictures and the sensitivity study five, the long run one as a check."""
    if condition.name in (LONG, LLM):
        return range(1)
    return range(count if condition.tested else min(count, SHORT_SEEDS))


def _job(
    condition: Condition,
    scenario: str,
    budget: Budget,
    seeds: Iterable[int],
    out: Path,
    llm: Mapping[str, Any] | None,
    learner: str,
) -> Job:
    """All seeds of a condition that are missing, which learn together."""
    paths = {seed: run_file(out, scenario, budget.name, condition.name, seed) for seed in seeds}
    missing = {seed: path.absolute() for seed, path in paths.items() if not _is_whole(path)}
    run = partial(_run, condition, scenario, budget, missing, llm, learner)
    seeds_told = ", ".join(map(str, missing))
    return Job(f"{scenario} {condition.name} seeds {seeds_told}", run, _keep, lambda: not missing)


def _run(
    condition: Condition,
    scenario: str,
    budget: Budget,
    paths: Mapping[int, Path],
    llm: Mapping[str, Any] | None,
    learner: str,
) -> dict[Path, str]:
    """Run it in a worker; gives the files' texts, which the driver writes if it is elsewhere."""
    run_experiment(condition, scenario, budget, paths, llm, learner)
    return {path: path.read_text() for path in paths.values()}


def _keep(texts: Mapping[Path, str]) -> None:
    for path, text in texts.items():
        if not path.is_file():
            write_whole(path, text)


def _is_whole(path: Path) -> bool:
    """Whether a run's file is there; one that is no table of a run is an error, not run over."""
    return path.is_file() and bool(read_windows(path))
