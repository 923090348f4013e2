"""``fpg-bench plan compare``: planners side by side."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.cli.options import (
    CallsOption,
    DeadlineOption,
    PromptOption,
    SecondsOption,
    ServerOption,
    TokensOption,
    llm_options,
)


def compare(
    planners: Annotated[
        list[str] | None,
        typer.Argument(
            help="planners, package.module:object, llm, llm-shuffled-rewards, llm-no-history; "
            "all (as if none is named): those that ask no language model"
        ),
    ] = None,
    panel: Annotated[str, typer.Option(help="a panel's name or YAML file")] = "planner-v1",
    out: Annotated[Path, typer.Option(help="the results folder")] = Path("comparison"),
    matches: Annotated[int | None, typer.Option(help="matches per ally; default: the panel's")] = None,
    transcripts: Annotated[
        Path | None, typer.Option(help="a folder of language models' transcripts: one more planner each")
    ] = None,
    prompt: PromptOption = None,
    server: ServerOption = None,
    calls: CallsOption = None,
    tokens: TokensOption = None,
    seconds: SecondsOption = None,
    deadline: DeadlineOption = None,
    concurrency: Annotated[int | None, typer.Option(min=1, help="llm: calls under way at once")] = None,
) -> None:
    """Compare planners by a panel; matches that are in the folder already are not played again."""
    from rich.progress import Progress

    from fpg_bench.evaluation.compare import compare as compare_planners

    caps = {"calls": calls, "tokens": tokens, "seconds": seconds, "concurrency": concurrency}
    llm = llm_options(deadline, prompt=prompt, server=server, **caps)
    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=None)

        def show(who: Any, ally: str, rounds: int) -> None:
            bar.update(task, description=f"{who.name} - {ally}, {rounds} rounds played")

        compare_planners(
            planners or ["all"],
            panel,
            out,
            matches=matches,
            transcripts=transcripts,
            llm=llm,
            progress=show,
        )
    _print_table(out)


def _print_table(folder: Path) -> None:
    from fpg_bench.cli.verbs import print_results
    from fpg_bench.evaluation import planner_table as tables
    from fpg_bench.evaluation.compare import read_comparison

    summaries, panel = read_comparison(folder)
    tables.write_planner_table(summaries, panel, folder)
    lines = [tables.planner_cells(summary) for summary in summaries]
    print_results(tables.planner_headings(panel), lines, tables.planner_caption(panel), folder)
