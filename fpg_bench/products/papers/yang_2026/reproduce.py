"""Reproduction of the paper: run its experiments, draw its figures and write the report."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_writable
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.products.papers.yang_2026.conditions import (
    ALL,
    LLM,
    LONG,
    SHORT_SEEDS,
    TABLES,
    Condition,
    conditions_of,
)
from fpg_bench.products.papers.yang_2026.experiment import (
    BUDGETS,
    LEARNERS,
    Budget,
    check_learner,
    run_experiment,
)
from fpg_bench.products.papers.yang_2026.figures import draw
from fpg_bench.products.papers.yang_2026.report import write_report
from fpg_bench.products.papers.yang_2026.runs import RunFile, read_results


def reproduce(
    target: str = "all",
    out: str | Path = "reproduced",
    *,
    scenario: str = "paper",
    n_seeds: int | None = None,
    first_seed: int = 0,
    budget: str | Budget = "quick",
    llm: bool = False,
    transcript: str | Path | None = None,
    learner: str = "torch",
    workers: Workers | int = 2,
) -> list[Path]:
    """Run the experiments behind a figure of the paper, draw it, and report on all runs in the folder.

    Finished runs are kept, and a second call continues with the missing ones.

    Args:
        target: ``fig3`` to ``fig7``, ``tables`` or ``all``.
        out: folder of runs, figures and reports.
        scenario: ``paper``, ``standard`` or ``figures``.
        n_seeds: number of runs of each condition that a claim rests on (others: at most five). None: the
            default of the budget.
        first_seed: first training seed. Confirming a finding requires seeds that were not used to find it.
        budget: ``quick``, ``full``, ``hundredth``, ``tenth``, ``paper``, or a :class:`Budget`.
        llm: train against the language-model planner as well; the environment names its endpoint.
        transcript: transcript of a language model, which is replayed in its place.
        learner: ``torch`` or ``jax``; the latter is faster and requires the extra ``fast``.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The files written: figures first, then the report.

    Raises:
        UserError: an unknown name, or failed runs (the others are kept).
    """
    budget, out = _budget(budget), Path(out)
    check_writable(out)
    check_learner(learner)
    count = integer(budget.seeds if n_seeds is None else n_seeds, "n_seeds")
    seeds = range(first_seed, first_seed + count)
    file = RunFile(out, scenario, budget.name)
    conditions = _conditions(target, scenario, budget, llm or transcript is not None)
    with locked(file.path):
        failed = run_jobs(_missing(file, conditions, scenario, budget, seeds, transcript, learner), workers)
        names = [name for each in _conditions(ALL, scenario, BUDGETS["full"], True) for name in each.runs]
        results = read_results(file, dict.fromkeys(names, seeds))
        drawn = draw(results, scenario, out / "figures")
        command = f"fpg-bench reproduce yang-2026 {target} --scenario {scenario}"
        command += f" --budget {budget.name} --n-seeds {count}"
        command += f" --first-seed {first_seed}" if first_seed else ""
        command += f" --learner {learner}" if learner != LEARNERS[0] else ""
        reports = write_report(results, scenario, budget, drawn, out, command, target == TABLES)
        check_all_done(failed)
        return [*(path for paths in drawn.values() for path in paths), *reports]


def _missing(
    file: RunFile,
    conditions: Iterable[Condition],
    preset: str,
    budget: Budget,
    seeds: range,
    transcript: str | Path | None,
    learner: str,
) -> list[Job]:
    """Return a job for each run that a file lacks; the job adds it.

    Raises:
        UserError: the file holds runs of another game: a changed preset, or a renamed file.
    """
    stored, jobs = file.read(), []
    transcripts = (file.path.parent / "transcripts" / file.path.name.split(".")[0]).absolute()
    for condition in conditions:
        game = f"{preset}, {condition.scenario(preset).hash}"
        for run in stored.values():
            if run.condition == condition.name and run.about.scenario != game:
                raise UserError(
                    f"runs {file.path}: {run.condition}, seed {run.seed}, played another game than {preset} "
                    "is now; choose another --out, or remove the file"
                )
        for seed in _seeds(condition, seeds):
            if (condition.name, seed) not in stored:
                folder = transcripts / condition.name / f"seed_{seed}"
                train = partial(run_experiment, condition, preset, budget, seed, folder, transcript, learner)
                jobs.append(Job(f"{preset} {condition.name} seed {seed}", train, file.add))
    return jobs


def _budget(budget: str | Budget) -> Budget:
    if isinstance(budget, Budget):
        return budget
    if budget not in BUDGETS:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, BUDGETS)}")
    return BUDGETS[budget]


def _conditions(target: str, scenario: str, budget: Budget, llm: bool) -> list[Condition]:
    conditions = conditions_of(target, scenario, budget.name == "full")
    if llm and target in (ALL, "fig3", "fig7"):
        conditions.append(Condition(LLM, "llm"))
    return conditions


def _seeds(condition: Condition, seeds: range) -> range:
    """Return all seeds if a claim rests on the condition, else five; one for the long run and the LLM."""
    if condition.name in (LONG, LLM):
        return seeds[:1]
    return seeds if condition.tested else seeds[:SHORT_SEEDS]
