"""``fpg-bench reproduce``: the paper's figures, tables and claims."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import TRAINING, WorkersOption
from fpg_bench.common.extras import require_extra
from fpg_bench.common.output import print_line
from fpg_bench.common.parallel import Workers
from fpg_bench.products.language_models.options import PANEL


def reproduce(
    target: Annotated[str, typer.Argument(help="fig3, fig4, fig5, fig6, fig7, tables or all.")] = "all",
    out: Annotated[Path, typer.Option(help="Folder of rows, figures and reports.")] = Path("reproduced"),
    scenario: Annotated[str, typer.Option(help="paper, standard or figures.")] = "paper",
    budget: Annotated[
        str,
        typer.Option(
            help="quick (minutes), full (hours), hundredth, tenth or paper.", rich_help_panel=TRAINING
        ),
    ] = "quick",
    n_seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of training seeds of each condition. Default: that of the budget.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    first_seed: Annotated[
        int,
        typer.Option(
            min=0, help="First training seed; fresh seeds confirm a finding.", rich_help_panel=TRAINING
        ),
    ] = 0,
    learner: Annotated[
        str, typer.Option(help="torch, or jax, which is faster (extra fast).", rich_help_panel=TRAINING)
    ] = "torch",
    workers: WorkersOption = Workers(2),
    llm: Annotated[
        bool,
        typer.Option(
            "--llm",
            help="Also run the language model that the environment variables name.",
            rich_help_panel=PANEL,
        ),
    ] = False,
    transcript: Annotated[
        Path | None,
        typer.Option(
            help="Replay this transcript of a language model, without a server.", rich_help_panel=PANEL
        ),
    ] = None,
) -> None:
    """Run the paper's experiments, draw its figures and report its claims; run it again to resume.

    Example: fpg-bench reproduce fig7 --budget quick --out reproduced
    """
    require_extra("train", "torch", "stable_baselines3", "matplotlib", "jinja2", "markdown_it")
    from fpg_bench.products.paper.reproduce import reproduce as run

    written = run(
        target,
        out,
        scenario=scenario,
        n_seeds=n_seeds,
        first_seed=first_seed,
        budget=budget,
        workers=workers,
        llm=llm,
        transcript=transcript,
        learner=learner,
    )
    for path in written:
        print_line(f"written: {path}")
