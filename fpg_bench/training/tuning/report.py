"""A study as one page: its history, what matters, slices, and a table of its trials."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import optuna
from optuna import visualization
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.training.tuning.storage import open_storage
from fpg_bench.training.tuning.study import find_study
from fpg_bench.training.tuning.task import Task
from fpg_bench.training.tuning.worker import shown

PAGE = "report.html"
_SEEN = (TrialState.COMPLETE, TrialState.PRUNED, TrialState.FAIL, TrialState.RUNNING)
_PLOTS: tuple[tuple[str, Callable[[optuna.Study], Any]], ...] = (
    ("The best score so far", visualization.plot_optimization_history),
    ("Scores along the way", visualization.plot_intermediate_values),
    ("Which values matter", visualization.plot_param_importances),
    ("Scores by each value", visualization.plot_slice),
)
# The library's words, and ours
_WORDS = {
    "Best Value": "best score so far",
    "Feasible Trial": "trial",
    "Hyperparameter": "",
    "Hyperparameter Importance": "share of the score's variance",
    "Intermediate Value": "score",
    "Objective Value": "score",
    "Step": "evaluation during training",
    "Trial": "trial",
}


def write_report(
    out: str | Path,
    *,
    storage: str | None = None,
    name: str | None = None,
    say: Callable[[str], None] = print,
) -> Path:
    """Write ``report.html`` into a study's folder; the page needs no network.

    Args:
        out: the study's folder.
        storage, name, say: as in :func:`fpg_bench.training.tuning.tune.tune`.

    Returns:
        The page.

    Raises:
        UserError: no study, or one without complete trials.
    """
    opened = open_storage(Path(out), storage, say=say, there=True)
    study, task = find_study(opened, name)
    if not study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
        raise UserError(f"study {study.study_name!r} in {opened.where}: no trial is complete yet")
    page = Path(out) / PAGE
    write_whole(page, _page(study, task))
    return page


def _page(study: optuna.Study, task: Task) -> str:
    title = html.escape(f"Study {study.study_name}")
    about = html.escape(
        f"{task.algorithm} on {task.env_id}, {task.seeds} seeds of {task.steps:,} steps a trial; score: "
        f"score on {task.suite}, tuning seeds, {task.rounds} rounds per rival."
    )
    style = (
        "body{font-family:sans-serif;margin:1em auto;padding:0 1em;max-width:75em}"
        "td,th{padding:.2em .8em;text-align:left}.table{overflow-x:auto}"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{style}</style>'
        '<meta name="viewport" content="width=device-width">'
        f"<h1>{title}</h1><p>{about}</p>{_plots(study)}<h2>Trials</h2>{_table(study, task)}</html>\n"
    )


def _plots(study: optuna.Study) -> str:
    """The plots; the first one carries the library for all."""
    found, library = [], True
    for heading, plot in _PLOTS:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                figure = _in_our_words(plot(study))
            drawn = figure.to_html(full_html=False, include_plotlyjs=library, config={"responsive": True})
        except (ValueError, RuntimeError) as error:  # too few trials for importances
            drawn = f"<p>{html.escape(str(error))}</p>"
        else:
            library = False
        found.append(f"<h2>{heading}</h2>{drawn}")
    return "".join(found)


def _in_our_words(figure: Any) -> Any:
    figure.update_layout(title=None, margin={"t": 20, "l": 60, "r": 20})
    figure.for_each_trace(lambda trace: trace.update(name=_WORDS.get(trace.name, trace.name)))
    for each in (figure.for_each_xaxis, figure.for_each_yaxis):
        each(lambda axis: axis.update(title_text=_WORDS.get(axis.title.text, axis.title.text)))
    return figure


def _table(study: optuna.Study, task: Task) -> str:
    lines = ["<tr><th>trial<th>state<th>score<th>95 % interval<th>values"]
    for trial in sorted(study.get_trials(deepcopy=False, states=_SEEN), key=lambda t: -(t.value or -1e9)):
        drawn = trial.params.keys() >= task.space.keys()  # it may have ended before all its values were
        values = shown(task.ranges().values(trial.params)) if drawn else ""
        low, high, _ = trial.user_attrs.get("interval", (None, None, ""))
        interval = "" if low is None else f"[{low:.1f}, {high:.1f}]"
        score = "" if trial.value is None else f"{trial.value:.1f}"
        state = trial.user_attrs.get("error") or trial.state.name.lower()
        cells = (str(trial.number), state, score, interval, values)
        lines.append("<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in cells))
    return f'<div class="table"><table>{"".join(lines)}</table></div>'
