"""The verbs ``evaluate`` and ``table``, and the printing of progress and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import (
    AllowOption,
    JsonOption,
    ReuseOption,
    SuiteOption,
    WideOption,
    WorkersOption,
    complete_player,
    llm_options,
    print_json,
)
from fpg_bench.common.files import check_target
from fpg_bench.common.output import shown_progress
from fpg_bench.common.parallel import Workers
from fpg_bench.common.products import load


def evaluate(
    players: Annotated[
        list[str],
        typer.Argument(
            help="Scripts, agents, all-scripted, or groups of training seeds: runs/ppo, ally-scripted/sac; "
            "planners for a suite of these. NAME=PLAYER names its row.",
            autocompletion=complete_player,
        ),
    ],
    suite: SuiteOption = "ally-v2",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("results"),
    matches: Annotated[
        int | None, typer.Option(help="Number of matches per rival. Default: that of the suite.")
    ] = None,
    wide: WideOption = False,
    workers: WorkersOption = Workers(1),
    allow: AllowOption = None,
    reuse: ReuseOption = False,
    *,
    planner_options: Annotated[Given, llm_options("evaluate")],
) -> None:
    """Evaluate players on a suite; existing records are kept and not played again.

    Example: fpg-bench evaluate runs/ppo_0/agent all-scripted --suite ally-v2 --out results/mine
    """
    from fpg_bench.evaluation.evaluate import evaluate as evaluate_players

    with shown_progress() as show:
        evaluate_players(
            players,
            suite,
            out,
            matches=matches,
            progress=lambda entry, rival, rounds, *of: show(f"{entry.name} - {rival.name}", *of),
            workers=workers,
            allow=allow or (),
            reuse=reuse,
            planner_options=planner_options,
        )
    table(out, wide)


def table(
    folder: Annotated[Path, typer.Argument(help="Folder of the results.")],
    wide: WideOption = False,
    out: Annotated[Path | None, typer.Option(help="Write only the figure, as .png, .svg or .pdf.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the table of a results folder, and write it as Markdown, CSV, LaTeX and PNG.

    Example: fpg-bench table results/mine --wide
    """
    from fpg_bench.common.canvas import check_figure
    from fpg_bench.evaluation import table as tables
    from fpg_bench.evaluation.evaluate import read_results

    if out is not None:
        check_figure(out)
        check_target(out)
    summaries, suite = read_results(folder)
    if out is not None:
        load("rendering", "table")(summaries, suite, out)
        typer.echo(f"written: {out}")
        return
    if as_json:
        print_json(tables.flat_lines(summaries))
        return
    tables.write_table(summaries, suite, folder)
    width = None if wide else terminal_width()
    head, *lines = tables.lines_of_table(summaries, suite, width)
    print_table(head, lines, tables.caption(summaries, suite))
    typer.echo(f"written: {folder}/table.md, table.csv, table.tex, table.png")


def terminal_width() -> int:
    """Return the width of the terminal in characters; 80 without a terminal."""
    from rich.console import Console

    return Console().width


def print_table(names: list[str], lines: list[list[str]], below: str) -> None:
    """Print a table at its full width, even on a narrower terminal, and its caption."""
    from rich.console import Console

    from fpg_bench.evaluation.table import text_table

    drawn = text_table(names, lines)
    width = terminal_width()
    wide = Console(width=max(width, 1000))
    Console(width=max(width, wide.measure(drawn).maximum)).print(drawn)
    Console(width=width, highlight=False).print(below)
