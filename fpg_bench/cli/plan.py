"""The verbs of ``fpg-bench plan``: the planners of the opponent's path."""

from __future__ import annotations

import typer

app = typer.Typer(help="Plan the opponent's path between the rounds of a match.")


@app.callback()
def _options() -> None:
    pass
