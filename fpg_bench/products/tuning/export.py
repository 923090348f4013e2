"""Export: retrain the best trials of a study on fresh seeds, and write the best values into a file."""

from __future__ import annotations

import logging
import textwrap
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import optuna
import yaml

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_target, write_whole
from fpg_bench.common.imports import check_allowed, reason
from fpg_bench.common.parallel import Job, Workers, run_jobs
from fpg_bench.evaluation.statistics import TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.products.tuning.objective import FAILURES, Objective
from fpg_bench.products.tuning.space import from_params, merge_values
from fpg_bench.products.tuning.study import (
    Storage,
    Task,
    best_trials,
    count_finished,
    load_study,
    open_storage,
)
from fpg_bench.training.rl_zoo3_format import Entry

N_BEST = 3
N_SEEDS = 3
FRESH_SEED = 200_000  # used neither by trials nor by shipped agents

_PACKAGES = ("fpg-bench", "stable-baselines3", "torch", "optuna")
_PRESENT = "present values"
_COMMENT = "  # tuned: "
_CONTINUED = "  #        "

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Confirmed:
    """A trial that was retrained on fresh seeds.

    Attributes:
        study_name: name of the study.
        n_trials: number of its finished trials.
        trial: number of the trial.
        values: the tuned hyper-parameters, by name.
        study_score: score of the trial in the study.
        score: score on the fresh seeds, with its interval.
        seeds: the fresh training seeds.
        task: the study's task, with the budget of the retraining.
    """

    study_name: str
    n_trials: int
    trial: int
    values: Entry
    study_score: float
    score: Interval
    seeds: range
    task: Task


def export_values(
    out: str | Path,
    file: str | Path,
    *,
    n_best: int = N_BEST,
    n_seeds: int = N_SEEDS,
    steps: int | None = None,
    force: bool = False,
    study_name: str | None = None,
    storage: str | None = None,
    workers: Workers | int = 1,
    allow: Collection[str] = (),
) -> list[Confirmed]:
    """Retrain the best trials of a study on the same fresh seeds, and write the best values into a file.

    The values that the study began with are retrained as well for comparison. The study stores the score of
    each training, so that none is repeated.

    Args:
        out: the study's folder.
        file: the hyper-parameter file to write; one of an earlier export is replaced.
        n_best: number of trials to retrain.
        n_seeds: number of fresh training seeds.
        steps: training budget of a seed; None for that of the study.
        force: write the values even if they score less than the present ones.
        study_name: name of the study; None for the only one in the storage.
        storage: SQLAlchemy URL of a database; None for SQLite in the folder.
        workers: number of parallel trainings, or :class:`fpg_bench.common.parallel.Workers`.
        allow: the ``package.module:object`` and agents of the Hub that the study and its suite may name;
            neither is run on their word.

    Returns:
        The trials that could be trained on all seeds, best first.

    Raises:
        UserError: there is no study or no complete trial, the database fails, the file cannot be
            written, no trial could be retrained, or the best one scores less on the fresh seeds than the
            present values.
    """
    for name, value in (("n_best", n_best), ("n_seeds", n_seeds), ("steps", steps)):
        if value is not None:
            integer(value, name)
    _check_file(Path(file))
    opened = open_storage(Path(out), storage, must_exist=True)
    study, task = load_study(opened, study_name)
    check_allowed(task.model_dump(), allow, f"study {study.study_name!r} in {opened.where}")
    task = task.model_copy(update={"steps": steps or task.steps})
    with opened.errors():
        trials = best_trials(study, n_best)
        n_trials = count_finished(study)
    if not trials:
        raise UserError(f"study {study.study_name!r} in {opened.where}: no trial is complete yet")
    seeds = range(FRESH_SEED, FRESH_SEED + n_seeds)
    values = {f"trial {trial.number}": from_params(task.space, trial.params) for trial in trials}
    begun = task.hyperparameters
    present = next((name for name, each in values.items() if merge_values(begun, each) == begun), _PRESENT)
    candidates = values | ({} if present in values else {_PRESENT: {}})
    jobs = [
        Job(
            name := _run_name(candidate, seed, task.steps),
            partial(_train_again, task, changes, seed, allow),
            keep=partial(_store_score, opened, study, name),
            done=partial(_has_score, opened, study, name),
        )
        for candidate, changes in candidates.items()
        for seed in seeds
    ]
    run_jobs(jobs, workers)
    with opened.errors():
        stored = study.user_attrs
    by_seed = {
        candidate: np.array(scores)
        for candidate in candidates
        if None not in (scores := [stored.get(_run_name(candidate, seed, task.steps)) for seed in seeds])
    }
    intervals = {name: mean_interval(scores, TRAINING_SEEDS) for name, scores in by_seed.items()}
    confirmed = []
    for trial in trials:
        name = f"trial {trial.number}"
        if name in intervals:
            found, in_study = intervals[name], float(trial.value or 0.0)
            _logger.info("%s: %s on fresh seeds, %.1f in the study", name, format_score(found), in_study)
            about = study.study_name, n_trials, trial.number, values[name], in_study, found, seeds, task
            confirmed.append(Confirmed(*about))
    if not confirmed:
        raise UserError(f"{out}: no trial could be retrained on all fresh seeds; see the lines above")
    confirmed.sort(key=lambda trial: -trial.score.value)
    if present not in intervals:
        _logger.info("present values: could not be trained on all fresh seeds")
    elif present in values:
        _logger.info("present values: those of %s", present)
    else:
        _logger.info("present values: %s on fresh seeds", format_score(intervals[present]))
    best = confirmed[0]
    if present in by_seed and (name := f"trial {best.trial}") != present:
        gained = mean_interval(by_seed[name] - by_seed[present], TRAINING_SEEDS)  # from the same games
        apart = "" if abs(gained.value) > gained.half else ", which is not told apart from none"
        _logger.info("%s less the present values: %s, by seed%s", name, format_score(gained), apart)
    if not force and present in intervals and best.score.value < intervals[present].value:
        raise UserError(
            f"{file}: not written, on fresh seeds trial {best.trial} scores {best.score.value:.1f}, less "
            f"than the present values with {intervals[present].value:.1f}; search further, or add --force"
        )
    write_values(Path(file), best)
    _logger.info("written: %s, %s", file, task.game.id)
    return confirmed


def _run_name(candidate: str, seed: int, steps: int) -> str:
    """Return the name of a retraining, under which a study stores its score."""
    return f"{candidate} again, seed {seed}, {steps} steps"


def _train_again(task: Task, values: Entry, seed: int, allow: Collection[str]) -> float:
    try:
        return Objective(task, allow=allow).train(values, [seed]).value
    except UserError:
        raise
    except FAILURES as error:
        raise UserError(reason(error)) from error


def _store_score(storage: Storage, study: optuna.Study, name: str, score: float) -> None:
    with storage.errors():
        study.set_user_attr(name, score)
    _logger.info("%s: score %.1f", name, score)


def _has_score(storage: Storage, study: optuna.Study, name: str) -> bool:
    with storage.errors():
        return name in study.user_attrs


def _check_file(file: Path) -> None:
    """Raise UserError if the values cannot be written into a file, before anything is trained for it."""
    if file.exists() and _COMMENT not in file.read_text(encoding="utf-8"):
        raise UserError(f"hyper-parameters {file}: was not written by tune export; choose another file")
    check_target(file, "hyper-parameters")


def write_values(file: Path, best: Confirmed) -> None:
    """Write a file of hyper-parameters: a trial's values, and a comment on where they come from."""
    lines = [f"{best.task.game.id}:", *provenance(best)]
    for key, value in merge_values(best.task.hyperparameters, best.values).items():
        text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
        lines.append(f"  {key}: " + text.removesuffix("\n").removesuffix("\n..."))
    write_whole(file, "\n".join(lines) + "\n")


def provenance(best: Confirmed) -> list[str]:
    """Return the lines of the comment: study, trial, scores, seeds and versions."""
    task = best.task
    text = (
        f"study {best.study_name!r}, trial {best.trial} (of {best.n_trials}): "
        f"score {format_score(best.score)} over the fresh training seeds {best.seeds[0]} to {best.seeds[-1]} "
        f"of {task.steps:,} steps each, {best.study_score:.1f} in the study; "
        f"suite {task.suite} on tuning seeds, {task.rounds} rounds "
        "per rival; " + ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    )
    return textwrap.wrap(text, 110, initial_indent=_COMMENT, subsequent_indent=_CONTINUED)


def format_score(score: Interval) -> str:
    """Return a score with its interval, if it has one."""
    interval = f" [{score.low:.1f}, {score.high:.1f}]" if score.low < score.high else ""
    return f"{score.value:.1f}{interval}"
