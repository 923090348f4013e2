"""The verbs of ``fpg-bench plan``: the planners of the opponent's path."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Given, with_fields
from fpg_bench.cli.options import AllowOption, ReuseOption, SuiteOption, WideOption, llm_options
from fpg_bench.common.output import shown_progress
from fpg_bench.common.products import load

app = typer.Typer()


@app.callback()
def plan() -> None:
    """Compare planners of the opponent's path."""


@app.command()
@with_fields
def compare(
    planners: Annotated[
        list[str] | None,
        typer.Argument(
            help="Planners, package.module:object, llm, llm-shuffled-rewards, llm-no-history. "
            "Default: all that use no language model."
        ),
    ] = None,
    suite: SuiteOption = "planner-v1",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("comparison"),
    matches: Annotated[
        int | None, typer.Option(help="Number of matches per ally. Default: that of the suite.")
    ] = None,
    transcripts: Annotated[
        Path | None, typer.Option(help="Folder of transcripts of language models; each adds a planner.")
    ] = None,
    wide: WideOption = False,
    *,
    llm: Annotated[Given, llm_options("plan compare")],
    allow: AllowOption = None,
    reuse: ReuseOption = False,
) -> None:
    """Compare planners on a suite of allies; existing records are kept and not played again.

    Example: fpg-bench plan compare circle hill-climb interceptor --matches 10 --out results/planners
    """
    from fpg_bench.products.planning.compare import compare as compare_planners

    with shown_progress() as show:
        compare_planners(
            planners or ["all"],
            suite,
            out,
            matches=matches,
            transcripts=transcripts,
            llm=llm,
            progress=lambda entry, ally, rounds, *of: show(f"{entry.name} - {ally.name}", *of),
            allow=allow or (),
            reuse=reuse,
        )
    load("verb", "table")(out, wide)
