"""The verbs of ``fpg-bench scenario``: what a scenario plays, and whether a file of one is valid."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.options import JsonOption, print_json

if TYPE_CHECKING:
    from fpg_bench.evaluation.link_budget import Row

_HEADS: tuple[str, ...] = (
    *("jamming", "waveform", "m", "EIRP dBm", "loss dB", "received dBm", "noise dBm", "gain dB"),
    *("J/S dB", "passes dB", "SINR dB", "Mbit/s"),
)

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
    as_json: JsonOption = False,
) -> None:
    """Print what a scenario changes and, in the model link, its link budget.

    Example: fpg-bench scenario show link --picture link.png
    """
    from fpg_bench.common.errors import UserError
    from fpg_bench.common.extras import require_extra
    from fpg_bench.evaluation.link_budget import draw_link_budget, formulas, link_budget
    from fpg_bench.game.scenario import as_scenario

    played = as_scenario(scenario)
    is_link = played.snr_model == "link"
    if picture is not None and not is_link:
        raise UserError(f"--picture: for snr_model 'link' alone, got {played.snr_model!r}")
    rows = link_budget(played, link_m) if is_link else []
    if as_json:
        print_json(row._asdict() for row in rows)
    else:
        typer.echo(f"{played.name or scenario}\nhash {played.hash}")
        for name, value in played.to_dict().items():
            typer.echo(f"    {name}: {value}")
        if is_link:
            typer.echo(
                f"\nLink budget; rows with jamming: base station at {link_m:g} m, distance of the jammer"
            )
            typer.echo(formulas(played) + "\n")
            _print_table(rows)
    if picture is not None:
        require_extra("evaluate", "matplotlib")
        draw_link_budget(played, picture, link_m)
        typer.echo(f"drawn: {picture}", err=as_json)


def _print_table(rows: list[Row]) -> None:
    lines = [_HEADS]
    for jamming, waveform, metres, *levels in rows:
        texts = ("-" if level is None else f"{level:.1f}" for level in levels)
        lines.append((jamming, waveform, f"{metres:g}", *texts))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = [line[0].ljust(widths[0]), line[1].ljust(widths[1])]
        cells += [cell.rjust(width) for cell, width in zip(line[2:], widths[2:], strict=True)]
        typer.echo("  ".join(cells))


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="A YAML file of a scenario.")],
) -> None:
    """Check a scenario's file, and print its hash.

    Example: fpg-bench scenario check my.yml
    """
    from fpg_bench.game.scenario import Scenario

    scenario = Scenario.from_yaml(file)
    same = "" if scenario.name is None else f", the same as {scenario.name}"
    typer.echo(f"{file}: valid{same}\nhash {scenario.hash}")
