"""The report of a study: one page with its history, importances, slices and a table of trials."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable
from pathlib import Path

import optuna
import plotly.graph_objects as go
from optuna import visualization
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.training.tuning.space import format_values, from_params
from fpg_bench.training.tuning.study import Task, load_study, open_storage

PAGE = "report.html"
_PLOTS: tuple[tuple[str, Callable[[optuna.Study], go.Figure]], ...] = (
    ("Optimization history", visualization.plot_optimization_history),
    ("Intermediate scores", visualization.plot_intermediate_values),
    ("Importance of hyper-parameters", visualization.plot_param_importances),
    ("Scores by hyper-parameter", visualization.plot_slice),
)
_STYLE = (
    "body{font-family:sans-serif;margin:1em auto;padding:0 1em;max-width:75em}"
    "td,th{padding:.2em .8em;text-align:left}.table{overflow-x:auto}"
)


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
    """Return the plots; the first one carries Plotly's library for all."""
    parts, include_library = [], True
    for heading, plot in _PLOTS:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                figure = plot(study)
            figure.update_layout(title=None, margin={"t": 20, "l": 60, "r": 20})
            drawn = figure.to_html(
                full_html=False, include_plotlyjs=include_library, config={"responsive": True}
            )
            include_library = False
        except (ValueError, RuntimeError) as error:  # too few trials for importances
            drawn = f"<p>{html.escape(str(error))}</p>"
        parts.append(f"<h2>{heading}</h2>{drawn}")
    return "".join(parts)


def _table(study: optuna.Study, task: Task) -> str:
    trials = study.get_trials(deepcopy=False)
    rows: list[tuple[str, ...]] = [("trial", "state", "score", "95 % interval", "values")]
    rows += [
        _row(trial, task)
        for trial in sorted(
            trials, key=lambda trial: -1e9 if trial.value is None else trial.value, reverse=True
        )
        if trial.state != TrialState.WAITING
    ]
    lines = ["<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in row) for row in rows]
    lines[0] = lines[0].replace("<td>", "<th>")
    return f'<div class="table"><table>{"".join(lines)}</table></div>'


def _row(trial: FrozenTrial, task: Task) -> tuple[str, ...]:
    has_values = trial.params.keys() >= task.space.keys()  # it may have ended before all were suggested
    values = format_values(from_params(task.space, trial.params)) if has_values else ""
    low, high, _ = trial.user_attrs.get("interval", (None, None, ""))
    interval = "" if low is None else f"[{low:.1f}, {high:.1f}]"
    score = "" if trial.value is None else f"{trial.value:.1f}"
    state = trial.user_attrs.get("error") or trial.state.name.lower()
    return str(trial.number), state, score, interval, values
