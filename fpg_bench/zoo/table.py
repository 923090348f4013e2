"""The zoo's page: per view a table, learning curves, profiles and probabilities, made of its lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.evaluation.field import Field, load_field
from fpg_bench.evaluation.statistics import FEW_SEEDS
from fpg_bench.evaluation.summary import Summary, summarise
from fpg_bench.evaluation.table import as_markdown, bounds, number
from fpg_bench.files import write_whole
from fpg_bench.zoo.curves import curve_file
from fpg_bench.zoo.pictures import PICTURES, draw_curves, draw_improvement, draw_profiles, styles
from fpg_bench.zoo.scores import read_zoo_lines
from fpg_bench.zoo.zoo import Zoo, ZooView

PAGE = "README.md"
COMMAND = "python scripts/train_zoo.py --tables"
_MEASURES = (
    ("jammed %", "jamming_success_rate"),
    ("hops %", "hop_rate"),
)
_HEAD = f"""\
# The zoo

Trained agents, ready to play: one of these tables is a player by its name,
`fpg_bench.load_agent("ally-scripted/ppo/seed_0")`, and `fpg-bench zoo` lists all that are here.
`zoo.yml` says what is trained, `hyperparams/` how, `search/` how that was found, `agents/` holds the
policies, `fields/` whom they meet, and `scores/` one line per training seed and counterpart.
`python scripts/train_zoo.py` makes all of it again, and goes on where it was stopped;
`python scripts/train_zoo.py --check` plays every agent again and compares.
This page and its pictures are made by `{COMMAND}`.

A score is the mean over a field's counterparts of the return a step, on the scale of the track
([measures](../docs/measures.md#fields-and-scores)). The first field of a view is public: its counterparts
can be trained against. Players of a season's field were trained after the entries of that season had been
closed.
Intervals are 95 %, by Student's t: over training seeds, for scripts over matches. † marks fewer than three
training seeds. Time is that of training, on one core, without evaluations, at the speed of the fastest
training seed: the machine was shared, and the others were held up by other work.
"""
_PROFILES = (
    "Performance profiles: the share of runs (a training seed against a counterpart) that earn more than τ a "
    "step; thin lines are single training seeds, the grey one is the best script."
)
_IMPROVEMENT = (
    "Probability of improvement: how likely a new training of the one earns more than one of the other "
    "against a counterpart (Agarwal et al. 2021), over training seeds. Where nearly all "
    "seeds agree (an interval of no width), the interval is too narrow."
)
_CURVES = (
    "Learning curves: the score on tuning seeds, mean and range over training seeds, while they all train; "
    "the grey line is the best script on the evaluation seeds."
)


def write_page(zoo: Zoo) -> None:
    """Write the zoo's ``README.md`` and the pictures of all views that have lines."""
    text = page(zoo)
    for view in zoo.views:
        known = _summaries(zoo, view)[0]
        if any(summary.trained for summary in known):
            draw_pictures(zoo, view, known)
    write_whole(zoo.folder / PAGE, text)


def page(zoo: Zoo) -> str:
    """The text of the page, from the lines and agents that lie in the zoo's folder."""
    return "\n".join([_HEAD, *(_section(zoo, view) for view in zoo.views)])


def draw_pictures(zoo: Zoo, view: ZooView, summaries: Sequence[Summary]) -> None:
    """Draw a view's pictures beside its lines, of its public field."""
    paths = [zoo.scores(view) / f"{name}.svg" for name in PICTURES]
    best = best_script(summaries)
    shown = {s.entry: s.rewards.mean(axis=2) for s in summaries if s.trained or s is best}
    levels = {best.entry: best.score.value} if best else {}
    styled = styles(view.steps)
    if rows := curve_file(zoo, view).read():
        draw_curves(rows, levels, styled, paths[0])
    draw_profiles(shown, styled, paths[1])
    draw_improvement(shown, styled, paths[2])


def best_script(summaries: Sequence[Summary]) -> Summary | None:
    """The script with the highest score."""
    return next((s for s in summaries if not s.trained), None)


def _summaries(zoo: Zoo, view: ZooView) -> list[list[Summary]]:
    """The summaries of each of a view's fields, best first."""
    fields = map(load_field, view.fields)
    return [summarise(read_zoo_lines(zoo, view, field), field) for field in fields]


def _section(zoo: Zoo, view: ZooView) -> str:
    fields = [load_field(name) for name in view.fields]
    known, *others = _summaries(zoo, view)
    head = [f"## {view.name}", "", _described(view, fields), ""]
    if not known:
        return "\n".join([*head, "Not trained yet.", ""])
    body = [_table(zoo, view, known, others), ""]
    if any(summary.trained for summary in known):
        for name, words in zip(PICTURES, (_CURVES, _PROFILES, _IMPROVEMENT), strict=True):
            if name == PICTURES[0] and not curve_file(zoo, view).read():
                continue  # agents whose training was scored on another scale have no curves
            body += [words, "", f"![{name} of {view.name}](scores/{view.name}/{name}.svg)", ""]
    return "\n".join([*head, *body])


def _described(view: ZooView, fields: Sequence[Field]) -> str:
    options = "".join(f", {key} {_named(value)}" for key, value in view.options.items())
    met = "; ".join(
        f"`{field.name}` ({field.hash[:12]}): {len(field.counterparts)} counterparts, "
        f"{field.matches} matches each"
        for field in fields
    )
    return f"Trained on `{view.id}`{options}; measured against {met}. {fields[0].scale.told.capitalize()}."


def _named(value: Any) -> str:
    """An option's value, or those that are drawn from, as code."""
    names = [f"`{name}`" for name in (value if isinstance(value, list) else [value])]
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def _table(zoo: Zoo, view: ZooView, known: list[Summary], others: list[list[Summary]]) -> str:
    names = ["player", "seeds", "steps", "score", "95 % interval"]
    for name in view.fields[1:]:
        names += [f"on {name}", "95 % interval"]
    names += ["worst return a step", *(heading for heading, _ in _MEASURES), "time (min)"]
    cells = [_cells(zoo, view, summary, others) for summary in known]
    return as_markdown(names, cells, "").rstrip() + "\n"


def _cells(zoo: Zoo, view: ZooView, s: Summary, others: list[list[Summary]]) -> list[str]:
    few = " †" if 0 < s.training_seeds < FEW_SEEDS else ""
    steps, minutes = _training(zoo, view, s.entry) if s.trained else ("-", "-")
    elsewhere = [next((of for of in found if of.entry == s.entry), None) for found in others]
    lows = {f"{of.field.name}, {of.worst}": of.by_counterpart[of.worst].value for of in (s, *elsewhere) if of}
    worst = min(lows, key=lambda name: lows[name])
    return [
        f"**{s.entry}**" if s.trained else s.entry,
        str(s.training_seeds or "-"),
        steps,
        number(s.score.value),
        f"{bounds(s.score)}{few}",
        *(text for of in elsewhere for text in _scored(of)),
        f"{number(lows[worst])} {worst}",
        *(number(s.measures[name], 100) for _, name in _MEASURES),
        minutes,
    ]


def _scored(s: Summary | None) -> tuple[str, str]:
    return ("-", "-") if s is None else (number(s.score.value), bounds(s.score))


def _training(zoo: Zoo, view: ZooView, algorithm: str) -> tuple[str, str]:
    """An algorithm's training steps, and the minutes that its fastest training took."""
    about = [m.about() for m in zoo.members(f"{view.name}/{algorithm}") if m.shipped]
    seconds = [found["seconds"] for found in about if "seconds" in found]
    steps = f"{np.mean([found['training_steps'] for found in about]) / 1e6:.3g}M"
    return steps, number(min(seconds) / 60 if seconds else None)
