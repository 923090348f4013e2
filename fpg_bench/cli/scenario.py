"""The verbs of ``fpg-bench scenario``: what a scenario plays, and whether a file of one is valid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import JsonOption, print_json
from fpg_bench.common.products import load

app = typer.Typer(help="Show scenarios, and check files of your own.")


@app.command()
def show(
    scenario: Annotated[str, typer.Argument(help="A preset, or a YAML file.")] = "standard",
    link_m: Annotated[
        float, typer.Option(min=1.0, help="Distance of the base station in rows with jamming.")
    ] = 500.0,
    picture: Annotated[
        Path | None, typer.Option(help="Also draw SINR over distance, and the spectra, into this file.")
    ] = None,
    pays: Annotated[
        bool, typer.Option("--pays", help="Also play whether hopping pays here, for about a minute.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Print what a scenario changes and, in the model link, its link budget.

    With --pays and --json the rows are those of that answer.

    Example: fpg-bench scenario show link --picture link.png
    """
    from fpg_bench.common.errors import UserError
    from fpg_bench.game.scenario import as_scenario

    played = as_scenario(scenario)
    is_link = played.snr_model == "link"
    if picture is not None and not is_link:
        raise UserError(f"--picture: for snr_model 'link' alone, got {played.snr_model!r}")
    if not as_json:
        typer.echo(f"{played.name or scenario}\nhash {played.hash}")
        for name, value in played.to_dict().items():
            typer.echo(f"    {name}: {value}")
    if is_link and not (pays and as_json):
        load("rendering", "link budget")(played, link_m, picture, as_json)
    if pays:
        load("rendering", "worth of hopping")(played, as_json)
    elif as_json and not is_link:
        print_json(())


@app.command()
def check(file: Annotated[Path, typer.Argument(help="A YAML file of a scenario.")]) -> None:
    """Check a scenario's file, and print its hash.

    Example: fpg-bench scenario check my.yml
    """
    from fpg_bench.game.scenario import Scenario

    scenario = Scenario.from_yaml(file)
    same = "" if scenario.name is None else f", the same as {scenario.name}"
    typer.echo(f"{file}: valid{same}\nhash {scenario.hash}")
