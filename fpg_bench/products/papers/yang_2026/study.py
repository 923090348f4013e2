"""The study of the paper: which runs its figures need, and what is written of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Job
from fpg_bench.products.papers.yang_2026.conditions import (
    ALL,
    LLM,
    LONG,
    SHORT_SEEDS,
    Condition,
    conditions_of,
)
from fpg_bench.products.papers.yang_2026.experiment import BUDGETS, LEARNERS, check_learner, run_experiment
from fpg_bench.products.papers.yang_2026.figures import draw
from fpg_bench.products.papers.yang_2026.report import write_report
from fpg_bench.products.papers.yang_2026.runs import RunFile, read_results


@dataclass(frozen=True)
class DuelStudy:
    """The experiments behind a figure of the paper, and a report on all runs in the folder.

    Attributes:
        target: ``fig3`` to ``fig7``, or ``all``.
        scenario: ``paper``, ``standard`` or ``figures``.
        learner: ``torch`` or ``jax``; the latter is faster and requires the extra ``fast``.
        llm: train against the language-model planner as well; the environment names its endpoint.
        transcript: transcript of a language model, which is replayed in its place.

    Raises:
        UserError: an unknown target, scenario or learner.
    """

    target: str = ALL
    scenario: str = "paper"
    learner: str = LEARNERS[0]
    llm: bool = False
    transcript: str | Path | None = None

    def __post_init__(self) -> None:
        check_learner(self.learner)
        self.conditions("full")

    @property
    def arguments(self) -> str:
        """Return the paper's name, and the target, scenario and learner."""
        learner = f" --learner {self.learner}" if self.learner != LEARNERS[0] else ""
        return f"yang-2026 {self.target} --scenario {self.scenario}{learner}"

    @property
    def seeds(self) -> Mapping[str, int]:
        """Return the default number of training seeds by the name of a budget."""
        return {name: budget.seeds for name, budget in BUDGETS.items()}

    def conditions(self, budget: str) -> list[Condition]:
        """Return the conditions to run."""
        conditions = conditions_of(self.target, self.scenario, budget == "full")
        if (self.llm or self.transcript is not None) and self.target in (ALL, "fig3", "fig7"):
            conditions.append(Condition(LLM, "llm"))
        return conditions

    def file(self, out: Path, budget: str) -> Path:
        """Return the file of runs."""
        return RunFile(out, self.scenario, budget).path

    def missing(self, out: Path, budget: str, seeds: range) -> list[Job]:
        """Return a job for each run that the file lacks; the job adds it.

        All seeds are run if a claim rests on the condition, else five; one for the long run and the LLM.

        Raises:
            UserError: the file holds runs of another game: a changed preset, or a renamed file.
        """
        file, jobs = RunFile(out, self.scenario, budget), []
        stored, transcripts = file.read(), (out / f"transcripts/{self.scenario}-{budget}").absolute()
        for condition in self.conditions(budget):
            game = f"{self.scenario}, {condition.scenario(self.scenario).hash}"
            for run in stored.values():
                if run.condition == condition.name and run.about.scenario != game:
                    raise UserError(
                        f"runs {file.path}: {run.condition}, seed {run.seed}, played another game than "
                        f"{self.scenario} is now; choose another --out, or remove the file"
                    )
            most = 1 if condition.name in (LONG, LLM) else None if condition.tested else SHORT_SEEDS
            for seed in seeds[:most]:
                if (condition.name, seed) not in stored:
                    folder = transcripts / condition.name / f"seed_{seed}"
                    given = (self.scenario, BUDGETS[budget], seed, folder, self.transcript, self.learner)
                    train = partial(run_experiment, condition, *given)
                    jobs.append(Job(f"{self.scenario} {condition.name} seed {seed}", train, file.add))
        return jobs

    def report(self, out: Path, budget: str, seeds: range, command: str) -> list[Path]:
        """Write the figures and the report, and return the files."""
        file = RunFile(out, self.scenario, budget)
        every = [*conditions_of(ALL, self.scenario, True), Condition(LLM)]
        results = read_results(file, {name: seeds for each in every for name in each.runs})
        drawn = draw(results, self.scenario, out / "figures")
        about = (self.scenario, BUDGETS[budget], drawn, out, command)
        return [*(path for paths in drawn.values() for path in paths), *write_report(results, *about)]
