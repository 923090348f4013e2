"""The page of a reproduction: own figures beside the paper's, claims, and the source of each number."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from fpg_bench.common.canvas import PAGE, blank_figure, styled, styles_of, write_figure
from fpg_bench.common.files import write_whole
from fpg_bench.evaluation.statistics import mean_interval
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.products.papers.reproduction import (
    HOLDS,
    NOT_RUN,
    SEEDS,
    Paper,
    PaperResults,
    verdict,
    verdict_of,
)

_LEARNING = "The learners in the course of their training"


def write_page(paper: Paper, results: PaperResults, share: float, command: str, path: Path) -> list[Path]:
    """Write the page and its figures, and return their paths.

    Args:
        paper: the paper.
        results: its runs.
        share: length of their trainings as a share of the full one.
        command: command that repeats the runs.
        path: the page; the figures stand beside it.
    """
    figures = [path.with_suffix(".svg")]
    _draw(paper, results, figures[0])
    learning = []
    if paper.curve:
        figures.append(path.with_suffix(".learning.svg"))
        _draw_learning(paper, results, figures[1])
        learning = [f"## Learning\n\n![{_LEARNING}, with intervals]({figures[1].name})\n\n{_LEARNING}."]
    seeds = sorted({seed for *_, seed in results.rows})
    rows = results.rows.values()
    versions = ", ".join(sorted({str(row["versions"]) for row in rows}))
    minutes = sum(float(row["seconds"]) for row in rows) / 60
    first, *others = paper.measures
    what = paper.measures[first].capitalize()
    beside = ", ours and the paper's" if _has_values(paper) else ""
    shortened = f"**Trainings have {100 * share:g} % of the full length.** Claims may fail for that alone."
    data = path.with_suffix(".jsonl").name
    sections = [
        f"# {paper.facts.title}",
        *([shortened] if share < 1 else []),
        f"{paper.facts.citation}\n\n{paper.facts.about}",
        f"## Side by side\n\n{what}: mean over seeds with its 95 % interval, and "
        f"the paper's value ({paper.facts.published_in}).\n\n{_side_by_side(paper, results)}\n\n"
        f"![{what}{beside}]({figures[0].name})",
        f"## Claims\n\n{_claims(paper, results)}\n\nA claim holds if all its parts do, such as one for each "
        "learner. A part's margin is a difference of two players, or a tolerance less the deviation, with "
        "its 95 % interval over seeds (Student's t): the part holds if the interval is above zero, fails if "
        "it is below, and is open otherwise.",
        *learning,
        f"## Where each number comes from\n\n{_numbers(paper)}",
        "## What could not be had, and what differs\n\n"
        + "\n".join(f"- {each}" for each in paper.facts.missing),
        f"## How it was made\n\n`{command}`: seeds {', '.join(map(str, seeds))}; {minutes:.0f} minutes "
        f"in all. {versions}.",
    ]
    if others:
        also = ", ".join(f"`{name}`" for name in others)
        sections[-1] += f" [`{data}`]({data}) also has {also}."
    write_whole(path, "\n\n".join(sections) + "\n")
    return [path, *figures]


def _side_by_side(paper: Paper, results: PaperResults) -> str:
    first = next(iter(paper.measures))
    lines = [["", *chain.from_iterable((name, "paper") for name in paper.conditions)]]
    for player in paper.players:
        published = paper.facts.published.get(player, {})
        cells = ((_own(results, player, name, first), published.get(name, "-")) for name in paper.conditions)
        shown = (cell if isinstance(cell, str) else f"{cell:.3f}" for cell in chain.from_iterable(cells))
        lines.append([player, *shown])
    return markdown_table(lines)


def _own(results: PaperResults, player: str, condition: str, measure: str) -> str:
    interval = results.interval(player, condition, measure)
    if interval is None:
        return NOT_RUN
    return f"{interval.value:.3f}" + ("" if np.isnan(interval.half) else f" ± {interval.half:.3f}")


def _claims(paper: Paper, results: PaperResults) -> str:
    lines = [["claim", "source", "parts that hold", "least margin", "verdict"]]
    for claim in paper.claims:
        parts = claim.parts(results)
        held = sum(verdict_of(values) == HOLDS for values in parts.values())
        margins = [mean_interval(values, SEEDS) for values in parts.values() if len(values) > 1]
        least = min(margins, key=lambda margin: margin.value, default=None)
        shown = f"{least.value:.3f} [{least.low:.3f}, {least.high:.3f}]" if least else ""
        lines.append(
            [claim.statement, claim.source, f"{held} of {len(parts)}", shown, verdict(claim, results)]
        )
    return markdown_table(lines)


def _numbers(paper: Paper) -> str:
    lines = [[each.name, each.value, f"{each.source}: {each.where}"] for each in paper.facts.numbers]
    return markdown_table([["number or choice", "value", "source: place, or reason"], *lines])


def _has_values(paper: Paper) -> bool:
    """Return whether the paper gives a value, and not words alone."""
    return any(isinstance(each, float) for known in paper.facts.published.values() for each in known.values())


@styled
def _draw(paper: Paper, results: PaperResults, path: Path) -> None:
    """Draw the first measure with intervals, and the paper's values as empty marks beside them."""
    first = next(iter(paper.measures))
    figure = blank_figure(PAGE, 2.6)
    axes = figure.subplots()
    width = 0.8 / len(paper.players)
    for index, (player, style) in enumerate(styles_of(paper.players).items()):
        at = np.arange(len(paper.conditions)) + (index - (len(paper.players) - 1) / 2) * width
        own = [results.interval(player, condition, first) for condition in paper.conditions]
        values = [(np.nan, 0.0) if each is None else (each.value, np.nan_to_num(each.half)) for each in own]
        mean, half = np.transpose(values)
        axes.errorbar(at, mean, half, label=player, **style | {"ls": ""})
        known = paper.facts.published.get(player, {})
        published = [known.get(condition) for condition in paper.conditions]
        shown = [each if isinstance(each, float) else np.nan for each in published]
        axes.plot(at + width / 3, shown, **style | {"ls": "", "mfc": "none"})
    if _has_values(paper):
        axes.plot([], [], "o", color="black", mfc="none", label="the paper's value")
    axes.set_xticks(range(len(paper.conditions)), paper.conditions)
    axes.set_ylabel(first)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, handlelength=1)
    write_figure(figure, path)


@styled
def _draw_learning(paper: Paper, results: PaperResults, path: Path) -> None:
    """Draw a measure in the course of the training, a panel for each condition, with intervals over seeds."""
    figure = blank_figure(PAGE, 2.6)
    panels = figure.subplots(1, len(paper.conditions), sharex=True, sharey=True)
    for axes, condition in zip(panels, paper.conditions, strict=True):
        for player, style in styles_of(paper.players).items():
            own = [results.interval(player, condition, measure) for measure in paper.curve.values()]
            values = np.array([(each.value, np.nan_to_num(each.half)) for each in own if each])
            if len(values) == len(own) and np.ptp(values[:, 0]):  # rules do not learn
                axes.errorbar([*paper.curve], *values.T, label=player, **style)
        axes.set(title=condition, xlabel="share of the training", xscale="log")
        axes.set_yscale("symlog", linthresh=0.01)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel(next(iter(paper.curve.values())).split(",")[0])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    write_figure(figure, path)
