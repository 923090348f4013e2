"""The verbs of ``fpg-bench submit``: what is wrong with a submission, and what it is worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Check and verify submissions to the leaderboard.", no_args_is_help=True)


@app.command()
def check(folder: Annotated[Path, typer.Argument(help="the submission's folder")]) -> None:
    """Say what is wrong with a submission, line by line."""
    from fpg_bench.leaderboard.check import problems

    found = problems(folder)
    for line in found:
        typer.echo(f"{folder}: {line}")
    if found:
        raise typer.Exit(1)
    typer.echo(f"{folder}: nothing is wrong")
