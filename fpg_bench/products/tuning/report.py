"""The report of a study: one page with its history, importances, slices and a table of trials."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path

import numpy as np
import optuna
from matplotlib.figure import Figure
from optuna.distributions import CategoricalDistribution
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.canvas import COLOURS, Style, blank_figure, image_of, literal, styled
from fpg_bench.common.canvas import PAGE as WIDTH
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.products.tuning.space import format_values, from_params
from fpg_bench.products.tuning.study import Task, load_study, open_storage, state_of

PAGE = "report.html"
_STYLE = (
    ":root{color-scheme:light dark}body{font-family:sans-serif;margin:1em auto;padding:0 1em;max-width:62em}"
    "td,th{padding:.2em .8em;text-align:left}.table{overflow-x:auto}svg{max-width:100%;height:auto}"
)
_BLUE, _RED = COLOURS[:2]
_DOT: Style = {"color": _BLUE, "alpha": 0.7, "s": 12}
_PER_LINE = 3  # hyper-parameters of a line of panels


def write_report(out: str | Path, *, study_name: str | None = None, storage: str | None = None) -> Path:
    """Write ``report.html`` into a study's folder; the page needs no network.

    Args:
        out: the study's folder.
        study_name: name of the study; None for the only one in the storage.
        storage: SQLAlchemy URL of a database; None for SQLite in the folder.

    Returns:
        The page.

    Raises:
        UserError: there is no study or no complete trial, or the database fails.
    """
    opened = open_storage(Path(out), storage, must_exist=True)
    study, task = load_study(opened, study_name)
    with opened.errors():
        if not study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
            raise UserError(f"study {study.study_name!r} in {opened.where}: no trial is complete yet")
        text = _page(study, task)
    page = Path(out) / PAGE
    write_whole(page, text)
    return page


def _page(study: optuna.Study, task: Task) -> str:
    title = html.escape(f"Study {study.study_name}")
    summary = html.escape(
        f"{task.algorithm} on {task.game.id}, {task.n_seeds} seeds of {task.steps:,} steps a trial; score: "
        f"on {task.suite}, tuning seeds, {task.rounds} rounds per rival."
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>'
        '<meta name="viewport" content="width=device-width">'
        f"<h1>{title}</h1><p>{summary}</p>{_plots(study)}<h2>Trials</h2>{_table(study, task)}</html>\n"
    )


def _plots(study: optuna.Study) -> str:
    parts = []
    for heading, draw in _PLOTS:
        try:
            drawn = image_of(draw(study), "svg", heading).decode()
            drawn = drawn[drawn.index("<svg") :]  # an element of the page
        except (ValueError, RuntimeError) as error:  # too few trials for importances
            drawn = f"<p>{html.escape(str(error))}</p>"
        parts.append(f"<h2>{heading}</h2>{drawn}")
    return "".join(parts)


def _complete(study: optuna.Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


@styled
def _history(study: optuna.Study) -> Figure:
    """Draw the score of each trial, and the best so far."""
    figure = blank_figure(WIDTH, 2.4)
    axes = figure.subplots()
    numbers, scores = zip(*((trial.number, trial.value) for trial in _complete(study)), strict=True)
    axes.scatter(numbers, scores, label="trial", **_DOT)
    axes.step(numbers, np.maximum.accumulate(scores), where="post", color=_RED, label="best so far")
    axes.set(xlabel="trial", ylabel="score")
    axes.legend()
    return figure


@styled
def _intermediate(study: optuna.Study) -> Figure:
    """Draw the scores of each trial during its training; a cross marks where one was pruned."""
    figure = blank_figure(WIDTH, 2.4)
    axes = figure.subplots()
    for trial in study.get_trials(deepcopy=False):
        if trial.intermediate_values:
            steps, scores = zip(*sorted(trial.intermediate_values.items()), strict=True)
            axes.plot(steps, scores, lw=1, marker=".", color=_BLUE, alpha=0.4)
            if trial.state == TrialState.PRUNED:
                axes.plot(steps[-1], scores[-1], "x", color=_RED)
    axes.plot([], [], ".-", color=_BLUE, label="trial")
    axes.plot([], [], "x", color=_RED, label="pruned")
    axes.set(xlabel="evaluation", ylabel="score of the seeds so far")
    axes.legend()
    return figure


@styled
def _importances(study: optuna.Study) -> Figure:
    """Draw how much of the scores' variation each hyper-parameter explains."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = optuna.importance.get_param_importances(study)
    figure = blank_figure(WIDTH, 0.6 + 0.18 * len(found))
    axes = figure.subplots()
    axes.barh([literal(name) for name in found][::-1], list(found.values())[::-1], color=_BLUE)
    axes.set_xlabel("share of the variation that it explains")
    return figure


@styled
def _slices(study: optuna.Study) -> Figure:
    """Draw the score over each hyper-parameter."""
    trials = _complete(study)
    names = sorted({name for trial in trials for name in trial.params})
    lines = -(-len(names) // _PER_LINE)
    figure = blank_figure(WIDTH, 1.8 * lines)
    for name, axes in zip_longest(names, figure.subplots(lines, _PER_LINE, squeeze=False, sharey=True).flat):
        if name is None:
            axes.set_visible(False)
            continue
        with_it = [trial for trial in trials if name in trial.params]
        values, kind = [trial.params[name] for trial in with_it], with_it[0].distributions[name]
        is_choice = isinstance(kind, CategoricalDistribution)
        scores = [trial.value for trial in with_it]
        axes.scatter([literal(str(value)) for value in values] if is_choice else values, scores, **_DOT)
        if getattr(kind, "log", False):
            axes.set_xscale("log")
        axes.set_xlabel(literal(name))
    return figure


_PLOTS: tuple[tuple[str, Callable[[optuna.Study], Figure]], ...] = (
    ("History", _history),
    ("Scores during training", _intermediate),
    ("Importance of hyper-parameters", _importances),
    ("Scores by hyper-parameter", _slices),
)


def _table(study: optuna.Study, task: Task) -> str:
    trials = study.get_trials(deepcopy=False)
    rows: list[tuple[str, ...]] = [("trial", "state", "score", "95 % interval", "values")]
    ranked = sorted(_complete(study), key=lambda trial: -(trial.value or 0.0))
    rest = [t for t in trials if t.state not in (TrialState.COMPLETE, TrialState.WAITING)]
    rows += [_row(trial, task) for trial in (*ranked, *rest)]
    lines = ["<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in row) for row in rows]
    lines[0] = lines[0].replace("<td>", "<th>")
    return f'<div class="table"><table>{"".join(lines)}</table></div>'


def _row(trial: FrozenTrial, task: Task) -> tuple[str, ...]:
    has_values = trial.params.keys() >= task.space.keys()  # it may have ended before all were suggested
    values = format_values(from_params(task.space, trial.params)) if has_values else ""
    low, high, _ = trial.user_attrs.get("interval", (None, None, ""))
    interval = "" if low is None else f"[{low:.1f}, {high:.1f}]"
    score = f"{trial.value:.1f}" if trial.state == TrialState.COMPLETE else ""
    return str(trial.number), state_of(trial), score, interval, values
