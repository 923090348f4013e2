"""The paper's experiments from the runs to the report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.paper.cells import PRESET, every_condition, names
from fpg_bench.paper.cells_report import write_cells
from fpg_bench.paper.conditions import LLM, LONG, SHORT_SEEDS, Condition, conditions_of
from fpg_bench.paper.experiment import BUDGETS, Budget, checkpoint_of, run_experiment
from fpg_bench.paper.figures import draw
from fpg_bench.paper.keeping import Checkpoint
from fpg_bench.paper.report import write_report
from fpg_bench.paper.runs import Results, Run, RunFile, read_results
from fpg_bench.training.maddpg.multi_seed import LEARNERS, check_learner

CELLS = "cells"


def reproduce(
    target: str = "all",
    out: str | Path = "reproduced",
    *,
    scenario: str = "paper",
    seeds: int | None = None,
    first_seed: int = 0,
    budget: str | Budget = "quick",
    llm: Mapping[str, Any] | None = None,
    learner: str = "torch",
    **where: Any,
) -> list[Path]:
    """Run what a figure of the paper needs, draw it, and write the report of all runs that are there.

    Args:
        target: ``fig3`` to ``fig7``, ``tables`` or ``all``; or ``cells``, the readings that decide.
        out: the folder of runs, figures and reports; runs that are there already are not repeated.
        scenario: ``paper``, ``standard`` or ``figures``; of ``cells`` always readings of ``paper``.
        seeds: runs of each condition that a claim rests on (others: five at most); None: the budget's own.
        first_seed: of training; what confirms a finding needs seeds that had no part in it.
        budget: ``quick``, ``full``, ``hundredth``, ``tenth``, ``paper``, or one of one's own.
        llm: run the language model that the environment names as one more planner, with these options of
            its planner; ``transcript``: replay that file. None: it is not run, and the report says so.
        learner: who updates the networks, ``torch`` or ``jax``, which takes less time and needs the
            extra ``fast``.
        **where: ``workers``, ``backend``, ``address`` and ``say``; see :func:`.run_jobs`.

    Returns:
        The files written: figures, then the report.

    Raises:
        UserError: something unknown, or runs that failed (the others are kept).
    """
    budget = _budget(budget)
    check_learner(learner)
    count = whole(budget.seeds if seeds is None else seeds, "seeds")
    out, all_of = Path(out), CELLS if target == CELLS else "all"
    file = RunFile(out, CELLS if target == CELLS else scenario, budget.name)
    conditions = _conditions(target, scenario, budget, llm)
    preset = PRESET if target == CELLS else scenario
    listed = list(_jobs(file, conditions, preset, budget, (first_seed, count), llm, learner))
    every_seed = range(first_seed, first_seed + count)
    first = _results_of_figures(out, budget, every_seed) if target == CELLS else None
    failed = run_jobs(listed, **where)
    every = names(_conditions(all_of, scenario, BUDGETS["full"], {}))
    results = read_results(file, dict.fromkeys(every, every_seed))
    words = f"--budget {budget.name} --seeds {count}"
    words += f" --first-seed {first_seed}" if first_seed else ""
    words += f" --learner {learner}" if learner != LEARNERS[0] else ""
    if first is not None:
        commands = [f"fpg-bench reproduce {part} {words}" for part in ("all --scenario figures", CELLS)]
        written = write_cells(first, results, every_seed, budget, out, commands)
    else:
        drawn = draw(results, scenario, out / "figures")
        command = f"fpg-bench reproduce {target} --scenario {scenario} {words}"
        reports = write_report(results, scenario, budget, drawn, out, command)
        written = [*(path for paths in drawn.values() for path in paths), *reports]
    check_all_done(failed)
    return written


def _results_of_figures(out: Path, budget: Budget, seeds: range) -> Results:
    """The runs of the scenario ``figures`` that are there, which the cells are compared with."""
    file, conditions = RunFile(out, "figures", budget.name), conditions_of("all", "figures", full=False)
    there = file.read().values()
    for condition in conditions:
        _check_same_game(file, there, condition, "figures")
    return read_results(file, dict.fromkeys(names(conditions), seeds))


def _jobs(
    file: RunFile,
    conditions: Iterable[Condition],
    preset: str,
    budget: Budget,
    seeds: tuple[int, int],
    llm: Mapping[str, Any] | None,
    learner: str,
) -> Iterator[Job]:
    """What is missing of some conditions: a job each, whose seeds learn together."""
    there = file.read()
    place = (file.path.parent / "transcripts" / file.path.name.split(".")[0]).absolute()
    for condition in conditions:
        missing = [seed for seed in _seeds(condition, *seeds) if (condition.name, seed) not in there]
        _check_same_game(file, there.values(), condition, preset)
        if missing:
            name = f"{preset} {condition.name} seeds {', '.join(map(str, missing))}"
            words = condition, preset, budget, missing, place / condition.name
            keep = partial(_keep_rows, file, checkpoint_of(*words, learner))
            yield Job(name, partial(run_experiment, *words, llm, learner), keep)


def _check_same_game(file: RunFile, there: Iterable[Run], condition: Condition, preset: str) -> None:
    """Refuse to go on with rows of another game: a preset that has changed, or a file that was renamed."""
    game = f"{preset}, {condition.scenario(preset).hash}"
    for run in there:
        if run.condition == condition.name and run.about.get("scenario") != game:
            raise UserError(
                f"runs {file.path}: {run.condition}, seed {run.seed}, played another game than {preset} "
                "is now; choose another --out, or remove the file"
            )


def _keep_rows(file: RunFile, checkpoint: Checkpoint, runs: list[Run]) -> None:
    """Write runs down; then, and not before, their checkpoint is removed."""
    file.add(runs)
    checkpoint.remove()


def _budget(budget: str | Budget) -> Budget:
    if isinstance(budget, Budget):
        return budget
    if budget not in BUDGETS:
        raise UserError(f"budget: unknown {budget!r}{nearest(budget, BUDGETS)}")
    return BUDGETS[budget]


def _conditions(target: str, scenario: str, budget: Budget, llm: Mapping[str, Any] | None) -> list[Condition]:
    if target == CELLS:
        return every_condition()
    found = conditions_of(target, scenario, budget.name == "full")
    if llm is not None and target in ("all", "fig3", "fig7"):
        found.append(Condition(LLM, "path planned by a language model", {"planner": "llm"}))
    return found


def _seeds(condition: Condition, first: int, count: int) -> range:
    """Claims need all seeds, pictures and the sensitivity study five, the long run one as a check."""
    if condition.name in (LONG, LLM):
        return range(first, first + 1)
    return range(first, first + (count if condition.tested else min(count, SHORT_SEEDS)))
