"""``fpg-bench reproduce``: the paper's figures, tables and claims."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import say


def reproduce(
    target: Annotated[str, typer.Argument(help="fig3, fig4, fig5, fig6, fig7, tables or all")] = "all",
    scenario: Annotated[str, typer.Option(help="paper, standard or figures")] = "paper",
    seeds: Annotated[int | None, typer.Option(min=1, help="runs a condition; default: the budget's")] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="of training: other ones to confirm")] = 0,
    budget: Annotated[
        str, typer.Option(help="quick (minutes), full (hours), hundredth, tenth or paper")
    ] = "quick",
    out: Annotated[Path, typer.Option(help="the folder of rows, figures and reports")] = Path("reproduced"),
    jobs: Annotated[int, typer.Option(min=1, help="runs at once, one thread each")] = 2,
    backend: Annotated[str, typer.Option(help="loky (this machine) or ray (a cluster)")] = "loky",
    address: Annotated[str | None, typer.Option(help="of the Ray cluster, host:port")] = None,
    llm: Annotated[bool, typer.Option("--llm", help="run the environment's language model as well")] = False,
    transcript: Annotated[
        Path | None, typer.Option(help="replay this language model's transcript; no server is asked")
    ] = None,
    learner: Annotated[str, typer.Option(help="torch, or jax, which is faster (extra fast)")] = "torch",
) -> None:
    """Run the paper's experiments over seeds, draw its figures and say what holds; run it again to go on.

    Example: fpg-bench reproduce fig7 --budget quick --out reproduced
    """
    from fpg_bench.paper.reproduce import reproduce as run

    asked = llm or transcript is not None
    words = {} if transcript is None else {"transcript": str(transcript)}
    written = run(
        target,
        out,
        scenario=scenario,
        seeds=seeds,
        first_seed=first_seed,
        budget=budget,
        workers=jobs,
        backend=backend,
        address=address,
        llm=words if asked else None,
        learner=learner,
        say=say,
    )
    for path in written:
        say(f"written: {path}")
