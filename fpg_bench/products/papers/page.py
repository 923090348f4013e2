"""The page of a reproduction: own figures beside the paper's, claims, and the source of each number."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from fpg_bench.common.canvas import PAGE, blank_figure, styled, styles_of, write_figure
from fpg_bench.common.files import write_whole
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.products.papers.reproduction import (
    HOLDS,
    NOT_RUN,
    Paper,
    PaperResults,
    around,
    verdict,
    verdict_of,
)

_TEMPLATE = Path(__file__).with_name("page.md.j2")
Lines = list[list[str]]  # of a table; the first holds the headings


def render(template: Path, **values: object) -> str:
    """Return the text of a template, in which ``table`` makes lines of cells a table."""
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False)
    environment.filters["table"] = markdown_table
    return environment.from_string(template.read_text(encoding="utf-8")).render(values)


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
    if paper.curve:
        figures.append(path.with_suffix(".learning.svg"))
        _draw_learning(paper, results, figures[1])
    first, *others = paper.measures
    rows = results.rows.values()
    text = render(
        _TEMPLATE,
        facts=paper.facts,
        share=share,
        what=paper.measures[first].capitalize(),
        side_by_side=_side_by_side(paper, results),
        has_values=_has_values(paper),
        figures=[figure.name for figure in figures],
        claims=_claims(paper, results),
        numbers=_numbers(paper),
        command=command,
        seeds=sorted({seed for *_, seed in results.rows}),
        minutes=sum(float(row["seconds"]) for row in rows) / 60,
        versions=", ".join(sorted({str(row["versions"]) for row in rows})),
        data=path.with_suffix(".jsonl").name,
        others=others,
    )
    write_whole(path, text)
    return [path, *figures]


def _side_by_side(paper: Paper, results: PaperResults) -> Lines:
    first = next(iter(paper.measures))
    lines = [["", *chain.from_iterable((name, "paper") for name in paper.conditions)]]
    for player in paper.players:
        published = paper.facts.published.get(player, {})
        cells = ((_own(results, player, name, first), published.get(name, "-")) for name in paper.conditions)
        shown = (cell if isinstance(cell, str) else f"{cell:.3f}" for cell in chain.from_iterable(cells))
        lines.append([player, *shown])
    return lines


def _own(results: PaperResults, player: str, condition: str, measure: str) -> str:
    values = results.values(player, condition, measure)
    return around(values, 3) if values.size else NOT_RUN


def _claims(paper: Paper, results: PaperResults) -> Lines:
    lines = [["claim", "source", "parts that hold", "least margin", "verdict"]]
    for claim in paper.claims:
        parts = claim.parts(results)
        held = sum(verdict_of(values) == HOLDS for values in parts.values())
        margins = sorted(_mean(values) for values in parts.values() if len(values) > 1)
        least = [f"{mean:.3f} [{mean - half:.3f}, {mean + half:.3f}]" for mean, half in margins[:1]]
        cells = (f"{held} of {len(parts)}", "".join(least), verdict(claim, results))
        lines.append([claim.statement, claim.source, *cells])
    return lines


def _mean(values: np.ndarray) -> tuple[float, float]:
    """Return the mean over seeds, NaN for none, and half of its interval, 0 for a single one."""
    return (float(values.mean()) if values.size else np.nan), float(np.nan_to_num(student_half(values)))


def _numbers(paper: Paper) -> Lines:
    lines = [[each.name, each.value, f"{each.source}: {each.where}"] for each in paper.facts.numbers]
    return [["number or choice", "value", "source: place, or reason"], *lines]


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
        own = [_mean(results.values(player, condition, first)) for condition in paper.conditions]
        mean, half = np.transpose(own)
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
            own = [_mean(results.values(player, condition, measure)) for measure in paper.curve.values()]
            mean, half = np.transpose(own)
            if np.ptp(mean) > 0:  # rules do not learn; it is NaN where something was not run
                axes.errorbar([*paper.curve], mean, half, label=player, **style)
        axes.set(title=condition, xlabel="share of the training", xscale="log")
        axes.set_yscale("symlog", linthresh=0.01)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel(next(iter(paper.curve.values())).split(",")[0])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    write_figure(figure, path)
