"""The verbs ``play``, ``evaluate``, ``table`` and ``curves``, and the printing of progress and tables."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.completion import complete_player
from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import (
    GAME,
    OUTPUT,
    AllowOption,
    JsonOption,
    PlayerOption,
    ReuseOption,
    SuiteOption,
    WideOption,
    WorkersOption,
    game_options,
    llm_options,
    print_json,
)
from fpg_bench.common.errors import printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_target
from fpg_bench.common.ids import DUEL
from fpg_bench.common.output import is_terminal
from fpg_bench.common.parallel import Workers
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
    from fpg_bench.evaluation.watching import watch

    watch(ally, opponent, id=env_id, seed=seed, rounds=rounds, out=out, every=every, llm=llm, **game)


def evaluate(
    players: Annotated[
        list[str],
        typer.Argument(
            help="Scripts, agents, all-scripted, or groups of training seeds: runs/ppo, ally-scripted/sac. "
            "NAME=PLAYER names its row.",
            autocompletion=complete_player,
        ),
    ],
    suite: SuiteOption = "ally-v2",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("results"),
    matches: Annotated[
        int | None, typer.Option(help="Number of matches per rival. Default: that of the suite.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the agents in the table.")] = None,
    wide: WideOption = False,
    workers: WorkersOption = Workers(1),
    allow: AllowOption = None,
    reuse: ReuseOption = False,
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
            name=name,
            progress=lambda entry, rival, rounds, *of: show(f"{entry.name} - {rival.name}", *of),
            workers=workers,
            allow=allow or (),
            reuse=reuse,
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
        tables.picture(summaries, suite, out)
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
    from fpg_bench.evaluation.curves import draw_curves, levels_of, read_runs

    check_figure(out)
    check_target(out)
    write_figure(draw_curves(read_runs(runs), levels=levels_of(runs)), out)
    typer.echo(f"written: {out}")


@contextlib.contextmanager
def shown_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows what is under way, and how much of it is done: ``show(what, done, total)``.

    On a terminal it draws a bar with count, share and time left; elsewhere it prints a line each half minute.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.table import Column

    from fpg_bench.common.parallel import LINE_EVERY_S

    last_line = time.monotonic()
    columns = (
        TextColumn("{task.description}", markup=False, table_column=Column(ratio=1, no_wrap=True)),
        BarColumn(bar_width=16),
        MofNCompleteColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    is_hidden = not is_terminal(sys.stderr)
    with Progress(*columns, console=console, transient=True, expand=True, disable=is_hidden) as bar:
        task = bar.add_task("", total=None)

        def show(what: str, done: int, total: int) -> None:
            nonlocal last_line
            bar.update(task, description=printable(what), completed=done, total=total)
            if bar.disable and time.monotonic() - last_line >= LINE_EVERY_S:
                last_line = time.monotonic()
                if sys.stderr is not None:
                    print(printable(f"{what}: {done:,} of {total:,} rounds"), file=sys.stderr, flush=True)

        yield show


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
