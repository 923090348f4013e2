"""The zoo's page: per view a table, learning curves, profiles and probabilities, made of its score lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.evaluation.curves import curve_file
from fpg_bench.evaluation.exploits import exploit_lines
from fpg_bench.evaluation.panel import Panel, load_panel
from fpg_bench.evaluation.statistics import FEW_SEEDS
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import as_markdown, number
from fpg_bench.evaluation.zoo import Zoo, ZooView
from fpg_bench.evaluation.zoo_pictures import PICTURES, colours, draw_curves, draw_improvement, draw_profiles
from fpg_bench.evaluation.zoo_scores import read_lines, score_arrays, summarise_lines
from fpg_bench.files import write_whole
from fpg_bench.rows import Row

PAGE = "README.md"
COMMAND = "python scripts/train_zoo.py --tables"
_MEASURES = (
    ("overlap %", "overlap_ratio"),
    ("jammed %", "jamming_success_rate"),
    ("hops %", "hop_rate"),
)
_HEAD = f"""\
# The zoo

Trained agents, ready to play: one of these tables is a player by its name,
`fpg_bench.load_agent("ally-scripted/ppo/seed_0")`, and `fpg-bench zoo` lists all that are here.
`zoo.yml` says what is trained, `hyperparams/` how, `search/` how that was found, `agents/` holds the
policies, and `scores/` one line per training seed and panel entry.
`python scripts/train_zoo.py` makes all of it again, and goes on where it was stopped;
`python scripts/train_zoo.py --check` plays every agent again and compares.
This page and its pictures are made by `{COMMAND}`.

The score is the interquartile mean (IQM) over a panel's entries of the normalised return: 0 = random,
100 = the panel's reference. Intervals are 95 %: over training seeds (Student's t), for scripts over
evaluation seeds. † marks fewer than three training seeds; of a single one the interval is over rounds.
Time is that of training, on one core, without evaluations, at the speed of the fastest training seed: the
machine was shared, and the others were held up by other work.
"""
_PROFILES = (
    "Performance profiles: the share of runs (a training seed on an entry) that score more than τ; "
    "thin lines are single training seeds, the dashed one is the best script."
)
_IMPROVEMENT = (
    "Probability of improvement: how likely a new training of the one scores more than one of the other "
    "on an entry (Agarwal et al. 2021), over training seeds. Where nearly all "
    "seeds agree (an interval of no width), the interval is too narrow."
)
_CURVES = (
    "Learning curves: the score on tuning seeds, mean and range over training seeds, while they all train; "
    "the dashed line is the best script on the panel's own seeds. What is "
    "below -100 is cut off."
)


def write_page(zoo: Zoo) -> None:
    """Write the zoo's ``README.md`` and the pictures of all views that have score lines."""
    text = page(zoo)
    for view in zoo.views:
        panel = load_panel(view.panel)
        lines = read_lines(zoo, view, panel)
        if trained_names(lines):
            draw_pictures(zoo, view, panel, lines)
    write_whole(zoo.folder / PAGE, text)


def page(zoo: Zoo) -> str:
    """The text of the page, from the score lines and agents that lie in the zoo's folder."""
    return "\n".join([_HEAD, *(_section(zoo, view) for view in zoo.views)])


def trained_names(lines: Sequence[Row]) -> list[str]:
    """The algorithms that lines speak of, without the scripts."""
    return list(dict.fromkeys(line["algorithm"] for line in lines if line["training_seed"] is not None))


def draw_pictures(zoo: Zoo, view: ZooView, panel: Panel, lines: list[Row]) -> None:
    """Draw a view's pictures beside its score lines."""
    paths = [zoo.scores(view) / f"{name}.png" for name in PICTURES]
    summaries = summarise_lines(lines, panel)
    best = best_script(summaries)
    means = {name: found.mean(axis=2) for name, found in score_arrays(lines, panel).items()}
    shown = {s.player: means[s.player] for s in summaries if s.training_seeds or s is best}
    yardsticks = {best.player: best.score.value} if best else {}
    coloured = colours(view.steps)
    draw_curves(curve_file(zoo, view).read(), yardsticks, coloured, paths[0])
    draw_profiles(shown, coloured, paths[1])
    draw_improvement(shown, coloured, paths[2])


def best_script(summaries: Sequence[Summary]) -> Summary | None:
    """The script with the highest score."""
    return next((s for s in summaries if not s.training_seeds), None)


def _section(zoo: Zoo, view: ZooView) -> str:
    panel = load_panel(view.panel)
    lines = read_lines(zoo, view, panel)
    head = [f"## {view.name}", "", _described(view, panel), ""]
    if not lines:
        return "\n".join([*head, "Not trained yet.", ""])
    body = [_table(zoo, view, panel, lines), *_exploits(zoo, view)]
    if trained_names(lines):
        for name, words in zip(PICTURES, (_CURVES, _PROFILES, _IMPROVEMENT), strict=True):
            body += [words, "", f"![{name} of {view.name}](scores/{view.name}/{name}.png)", ""]
    return "\n".join([*head, *body])


def _described(view: ZooView, panel: Panel) -> str:
    options = "".join(f", {key} {_named(value)}" for key, value in view.options.items())
    return (
        f"Trained on `{view.id}`{options}; measured by panel `{panel.name}` ({panel.hash[:12]}): "
        f"{len(panel.entries)} entries, {panel.rounds} rounds each; 100 = `{panel.reference}`."
    )


def _named(value: Any) -> str:
    """An option's value, or those that are drawn from, as code."""
    names = [f"`{name}`" for name in (value if isinstance(value, list) else [value])]
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def _table(zoo: Zoo, view: ZooView, panel: Panel, lines: list[Row]) -> str:
    names = ["player", "seeds", "steps", "score", "95 % interval", "worst entry", f"{panel.side} return"]
    names += [heading for heading, _ in _MEASURES] + ["time (min)"]
    cells = [_cells(zoo, view, panel, summary) for summary in summarise_lines(lines, panel)]
    return as_markdown(names, cells, "").rstrip() + "\n"


def _exploits(zoo: Zoo, view: ZooView) -> list[str]:
    lines = exploit_lines(zoo, view)
    if not lines:
        return []
    lines.sort(key=lambda line: -min(line["responses"]))
    panel = load_panel(view.panel)
    scores = {s.player: s.score.value for s in summarise_lines(read_lines(zoo, view, panel), panel)}
    budgets = {(line["trained_by"], line["steps"]) for line in lines}
    told = " or ".join(f"{algorithm} with {steps / 1e6:.3g}M steps" for algorithm, steps in sorted(budgets))
    entries = ", ".join(sorted({f"`{line['entry']}`" for line in lines}))
    words = (
        f"Best responses: fresh players of the other side, trained by {told} each to lower what the agent "
        "earns, which learns no more (`python scripts/exploit_zoo.py`), against the first training seed of "
        "each algorithm. Its lowest score is an upper bound on its worst. 0 and 100 are what random and the "
        f"panel's reference earn at {entries}, so compare these scores with each other and with that against "
        "the strongest script; that on the panel, over all its entries, is on another scale."
    )
    cells = [
        [
            f"{line['algorithm']}/seed_{line['training_seed']}",
            number(scores.get(line["algorithm"])),
            number(min(line["responses"])),
            ", ".join(map(number, line["responses"])),
            f"{number(line['script_score'])} {line['script']}",
        ]
        for line in lines
    ]
    names = ["agent", "on the panel", "lowest", "against each response", "against the strongest script"]
    return [words, "", as_markdown(names, cells, "").rstrip(), ""]


def _cells(zoo: Zoo, view: ZooView, panel: Panel, s: Summary) -> list[str]:
    few = " †" if 0 < s.training_seeds < FEW_SEEDS else ""
    worst = min(s.entries, key=lambda name: s.entries[name])
    steps, minutes = _training(zoo, view, s.player) if s.training_seeds else ("-", "-")
    return [
        f"**{s.player}**" if s.training_seeds else s.player,
        str(s.training_seeds or "-"),
        steps,
        number(s.score.value),
        f"[{number(s.score.low)}, {number(s.score.high)}]{few}",
        f"{number(s.entries[worst])} {worst}",
        number(s.measures[f"{panel.side}_return"], digits=0),
        *(number(s.measures[name], 100) for _, name in _MEASURES),
        minutes,
    ]


def _training(zoo: Zoo, view: ZooView, algorithm: str) -> tuple[str, str]:
    """An algorithm's training steps, and the minutes that its fastest training took."""
    about = [m.about() for m in zoo.members(f"{view.name}/{algorithm}") if m.shipped]
    seconds = [found["seconds"] for found in about if "seconds" in found]
    steps = f"{np.mean([found['training_steps'] for found in about]) / 1e6:.3g}M"
    return steps, number(min(seconds) / 60 if seconds else None)
