"""The verbs ``play`` and ``curves``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import GAME, OUTPUT, PlayerOption, game_options, llm_options
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_target
from fpg_bench.common.ids import DUEL
from fpg_bench.common.products import offered


def play(
    ally: PlayerOption = "expert",
    opponent: PlayerOption = "adaptive",
    *,
    game: Annotated[Given, game_options("scenario", "path", "planner")],
    env_id: Annotated[
        str,
        typer.Option(
            "--id",
            help=f"The game: {' or '.join((DUEL, *offered('game')))}; agents of another play theirs.",
            rich_help_panel=GAME,
        ),
    ] = DUEL,
    seed: Annotated[int, typer.Option(help="Seed of the match.")] = 0,
    rounds: Annotated[int, typer.Option(min=1, help="Number of consecutive rounds.")] = 1,
    every: Annotated[
        int, typer.Option(min=1, help="Print only every n-th step.", rich_help_panel=OUTPUT)
    ] = 10,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write a page (.html), a picture (.png, .svg, .pdf) or a film (.gif, .mp4), and no text.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    llm: Annotated[Given, llm_options("play")],
) -> None:
    """Play rounds and show them as text, a picture, a video or an interactive page.

    Example: fpg-bench play --ally expert-spread --opponent adaptive --seed 12
    """
    from fpg_bench.products.rendering.watching import watch

    watch(ally, opponent, id=env_id, seed=seed, rounds=rounds, out=out, every=every, llm=llm, **game)


def curves(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or of seed_0, seed_1, ... each.")],
    out: Annotated[Path, typer.Option(help="The figure: .png, .svg or .pdf.")] = Path("curves.svg"),
) -> None:
    """Draw learning curves of several runs: the mean over training seeds, with its 95 % interval.

    Runs that differ by their training seed alone are one curve. Grey lines: random play, the best script.

    Example: fpg-bench curves runs/ppo_0 runs/ppo_1 runs/sac --out curves.svg
    """
    require_extra("evaluate", "scipy", "matplotlib")
    from fpg_bench.common.canvas import check_figure, write_figure
    from fpg_bench.products.rendering.curves import draw_curves, levels_of, read_runs

    check_figure(out)
    check_target(out)
    write_figure(draw_curves(read_runs(runs), levels=levels_of(runs)), out)
    typer.echo(f"written: {out}")
