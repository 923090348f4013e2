"""Reproduction of the paper: run its experiments, draw its figures and write the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_writable
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.paper.conditions import ALL, LLM, LONG, SHORT_SEEDS, TABLES, Condition, conditions_of
from fpg_bench.paper.experiment import BUDGETS, LEARNERS, Budget, check_learner, run_experiment
from fpg_bench.paper.figures import draw
from fpg_bench.paper.report import write_report
from fpg_bench.paper.runs import RunFile, read_results


def reproduce(
    target: str = "all",
    out: str | Path = "reproduced",
    *,
    scenario: str = "paper",
    n_seeds: int | None = None,
    first_seed: int = 0,
    budget: str | Budget = "quick",
    llm: Mapping[str, Any] | None = None,
    learner: str = "torch",
    n_jobs: int = 2,
    backend: str = "loky",
    address: str | None = None,
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
        llm: options of the language-model planner, which is then trained against as well; the environment
            names its endpoint. ``transcript`` replays that file. None: no language model.
        learner: ``torch`` or ``jax``; the latter is faster and requires the extra ``fast``.
        n_jobs, backend, address: see :func:`fpg_bench.common.parallel.run_jobs`.

    Returns:
        The files written: figures first, then the report.

    Raises:
        UserError: an unknown name, or failed runs (the others are kept).
    """
    budget, out = _budget(budget), Path(out)
    check_writable(out)
    check_learner(learner)
    count = whole(budget.seeds if n_seeds is None else n_seeds, "n_seeds")
    file = RunFile(out, scenario, budget.name)
    failed = run_conditions(
        file,
        _conditions(target, scenario, budget, llm),
        scenario,
        budget,
        range(first_seed, first_seed + count),
        llm=llm,
        learner=learner,
        n_jobs=n_jobs,
        backend=backend,
        address=address,
    )
    names = [name for each in _conditions(ALL, scenario, BUDGETS["full"], {}) for name in each.runs]
    results = read_results(file, dict.fromkeys(names, range(first_seed, first_seed + count)))
    drawn = draw(results, scenario, out / "figures")
    command = f"fpg-bench reproduce {target} --scenario {scenario} --budget {budget.name} --n-seeds {count}"
    command += f" --first-seed {first_seed}" if first_seed else ""
    command += f" --learner {learner}" if learner != LEARNERS[0] else ""
    reports = write_report(results, scenario, budget, drawn, out, command, target == TABLES)
    check_all_done(failed)
    return [*(path for paths in drawn.values() for path in paths), *reports]


def run_conditions(
    file: RunFile,
    conditions: Iterable[Condition],
    preset: str,
    budget: Budget,
    seeds: range,
    *,
    llm: Mapping[str, Any] | None = None,
    learner: str = "torch",
    n_jobs: int = 2,
    backend: str = "loky",
    address: str | None = None,
) -> dict[str, str]:
    """Run the missing runs of some conditions and add them to a file.

    Args:
        file: file of the runs.
        conditions: conditions to run.
        preset: name of the scenario that they change.
        budget: budget of each run.
        seeds: training seeds; see :func:`reproduce` for conditions that need fewer.
        llm, learner: see :func:`reproduce`.
        n_jobs, backend, address: see :func:`fpg_bench.common.parallel.run_jobs`.

    Returns:
        The errors of failed jobs by name.

    Raises:
        UserError: the file holds runs of another game.
    """
    done, jobs = file.read(), []
    transcripts = (file.path.parent / "transcripts" / file.path.name.split(".")[0]).absolute()
    for condition in conditions:
        check_same_game(file, condition, preset)
        for seed in _seeds(condition, seeds):
            if (condition.name, seed) not in done:
                folder = transcripts / condition.name / f"seed_{seed}"
                run = partial(run_experiment, condition, preset, budget, seed, folder, llm, learner)
                jobs.append(Job(f"{preset} {condition.name} seed {seed}", run, file.add))
    return run_jobs(jobs, n_jobs, backend, address)


def check_same_game(file: RunFile, condition: Condition, preset: str) -> None:
    """Raise UserError if a file holds runs of another game: a changed preset, or a renamed file."""
    game = f"{preset}, {condition.scenario(preset).hash}"
    for run in file.read().values():
        if run.condition == condition.name and run.about.get("scenario") != game:
            raise UserError(
                f"runs {file.path}: {run.condition}, seed {run.seed}, played another game than {preset} "
                "is now; choose another --out, or remove the file"
            )


def _budget(budget: str | Budget) -> Budget:
    if isinstance(budget, Budget):
        return budget
    if budget not in BUDGETS:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, BUDGETS)}")
    return BUDGETS[budget]


def _conditions(target: str, scenario: str, budget: Budget, llm: Mapping[str, Any] | None) -> list[Condition]:
    conditions = conditions_of(target, scenario, budget.name == "full")
    if llm is not None and target in (ALL, "fig3", "fig7"):
        conditions.append(Condition(LLM, "path planned by a language model", {"planner": "llm"}))
    return conditions


def _seeds(condition: Condition, seeds: range) -> range:
    """Return all seeds if a claim rests on the condition, else five; one for the long run and the LLM."""
    if condition.name in (LONG, LLM):
        return seeds[:1]
    return seeds if condition.tested else seeds[:SHORT_SEEDS]
