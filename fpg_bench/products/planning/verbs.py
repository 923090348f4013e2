"""The verbs of ``fpg-bench plan``: the planners of the opponent's path."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.completion import complete_player
from fpg_bench.cli.fields import Given, with_fields
from fpg_bench.cli.options import (
    GAME,
    AllowOption,
    ReuseOption,
    SuiteOption,
    WideOption,
    game_options,
    llm_options,
)
from fpg_bench.common.errors import UserError, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_target
from fpg_bench.common.output import wrapped
from fpg_bench.common.rows import Row

if TYPE_CHECKING:
    from fpg_bench.products.planning.match import Round

DRAW_EVERY_S = 5.0  # drawing takes about a second, many planners less

app = typer.Typer(help="Plan the opponent's path between the rounds of a match.")


@app.command()
@with_fields
def run(
    planner: Annotated[
        str, typer.Option(help="The planner: a name (see fpg-bench players), llm, or package.module:object.")
    ] = "interceptor",
    ally: Annotated[
        str,
        typer.Option(help="The ally's player.", autocompletion=complete_player, rich_help_panel=GAME),
    ] = "expert",
    opponent: Annotated[
        str,
        typer.Option(
            help="The opponent's player, which jams.",
            autocompletion=complete_player,
            rich_help_panel=GAME,
        ),
    ] = "adaptive",
    *,
    game: Annotated[Given, game_options("scenario")],
    seed: Annotated[int, typer.Option(help="Seed of the match.", rich_help_panel=GAME)] = 0,
    rounds: Annotated[int, typer.Option(min=1, help="Number of rounds.", rich_help_panel=GAME)] = 10,
    out: Annotated[
        Path | None,
        typer.Option(help="A folder, the file of the match (.jsonl), or its figure (.png, .svg or .pdf)."),
    ] = None,
    llm: Annotated[Given, llm_options("plan run")],
    talk: Annotated[
        bool, typer.Option("--talk", help="Print the prompts and answers.", rich_help_panel="Language model")
    ] = False,
) -> None:
    """Play one match of a planner and write it to a file; run it again to resume a stopped match.

    Also writes paths.png, updated every few seconds, and replay.html with all rounds beside match.jsonl.

    Example: fpg-bench plan run --planner interceptor --ally expert --rounds 10
    """
    require_extra("video", "matplotlib")
    from fpg_bench.products.planning.match import run_match
    from fpg_bench.products.planning.match_picture import draw_match, write_match_replay

    name = planner if llm.get("control", "none") == "none" else f"{planner}-{llm['control']}"
    file, picture, page = _targets(out, f"{name}-{ally}-{seed}")
    title = f"{name} against {ally}, seed {seed}"
    played: list[Round] = []
    drawn = time.monotonic()

    try:
        with _shown_progress(rounds) as show:

            def progress(index: int, round: Round | None) -> None:
                nonlocal drawn
                show(index, round)
                if round is None:
                    return
                played.append(round)
                if time.monotonic() - drawn > DRAW_EVERY_S:
                    draw_match(played, picture, title)
                    drawn = time.monotonic()
                if talk:
                    _print_talk(round)

            run_match(
                planner,
                ally,
                opponent,
                seed=seed,
                rounds=rounds,
                out=file,
                llm=llm,
                progress=progress,
                **game,
            )
    finally:
        if played:
            draw_match(played, picture, title)
    write_match_replay(played, page, title, ally, opponent)
    _print_table(played, title)
    typer.echo(f"written: {file}, {picture}, {page}")
    if not _has_score([round.row for round in played]):
        raise UserError(
            f"match {file}: none of {rounds} plans is valid, so it has no score ({_problem(played[-1])}); "
            "fix that and choose another --out"
        )


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(help="File written by plan run.")],
    allow: AllowOption = None,
) -> None:
    """Replay a match from its file, without a network, and check that it is identical to the bit.

    Example: fpg-bench plan replay runs/plan/interceptor-expert-0/match.jsonl
    """
    from fpg_bench.products.planning.match import replay_match

    match, played = replay_match(file, allow=allow or ())
    _print_table(played, f"{match.planner} against {match.ally}, seed {match.seed}")
    typer.echo(f"identical: {len(played)} rounds of {file}")


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
    from fpg_bench.cli.evaluation import shown_progress, table
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
    table(out, wide)


def _targets(out: Path | None, name: str) -> tuple[Path, Path, Path]:
    """Return the files of the match, its picture and its page.

    Raises:
        UserError: they would overwrite other files, or mix with them.
    """
    from fpg_bench.common.canvas import FIGURES

    path = Path("runs", "plan", name.replace("/", "_").replace(":", "_")) if out is None else out
    if path.suffix in (".jsonl", *FIGURES):
        check_target(path)
        picture = path.with_suffix(".png") if path.suffix == ".jsonl" else path
        file, page = path.with_suffix(".jsonl"), path.with_suffix(".html")
        is_free = not (picture.exists() or page.exists())
    else:
        file, picture, page = path / "match.jsonl", path / "paths.png", path / "replay.html"
        is_free = not path.exists() or (path.is_dir() and not any(path.iterdir()))
    if not is_free and not file.exists():
        raise UserError(f"out: {path} exists and is not a match of plan run; choose another")
    return file, picture, page


@contextlib.contextmanager
def _shown_progress(rounds: int) -> Iterator[Callable[[int, Round | None], None]]:
    """Show the progress of a match: a moving line on a terminal, otherwise one line per round."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console()
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task, latest = bar.add_task(""), ""

        def show(index: int, played: Round | None) -> None:
            nonlocal latest
            if played is None:
                bar.reset(task, description=f"planning round {index} of {rounds}  {latest}")
                return
            row = played.row
            latest = f"round {index}: {played.reward_per_step:+.2f} per step, {row['status']}"
            if played.problem:
                latest = f"round {index}: {row['status']}, {row['source']} flown ({_problem(played)})"
            if not console.is_terminal:
                typer.echo(latest)

        yield show


def _print_talk(played: Round) -> None:
    for attempt in played.talk:
        for who, text in attempt.messages():
            for line in (f"--- {who}", *text.splitlines()):
                typer.echo(printable(line))


def _problem(played: Round) -> str:
    return printable(played.problem or played.row["status"])


def _print_table(rounds: list[Round], title: str) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    radius = rounds[0].recording.scenario.distance_reward_m
    headings = ["round", "reward/step", f"within {radius:g} m %", "jamming success rate %"]
    headings += ["status", "source", "tokens", "planning s"]
    table = Table(*(wrapped(each, ()) for each in headings), box=box.SIMPLE_HEAD, title=title)
    for column in table.columns:
        column.justify = "left" if column.header in ("status", "source") else "right"
    rows = [played.row for played in rounds]
    for row in rows:
        table.add_row(str(row["round"]), *_numbers([row]), row["status"], row["source"], *_costs([row]))
    table.add_section()
    pooled = _numbers(rows) if _has_score(rows) else ["no score", "", ""]
    table.add_row("all", *pooled, _valid(rows), "", *_costs(rows))
    console = Console()
    console.print(table) if console.width >= 100 else Console(width=100).print(table)


def _numbers(rows: list[Row]) -> list[str]:
    """Return the reward per step and the percentages of time near the ally and of jamming, over rounds."""
    steps, reward, near, jammed = (
        sum(row[name] for row in rows) for name in ("steps", "opponent_return", "near", "jammed")
    )
    return [f"{reward / steps:+.2f}", f"{100 * near / steps:.1f}", f"{100 * jammed / steps:.1f}"]


def _costs(rows: list[Row]) -> list[str]:
    counted = [row["tokens"] for row in rows if row["tokens"] is not None]
    return [str(sum(counted)) if counted else "-", f"{sum(row['seconds'] for row in rows):.3f}"]


def _has_score(rows: list[Row]) -> bool:
    """Return False for a language model's match in which every round flew a fallback path."""
    return not all(row["status"].startswith("fallback") for row in rows)


def _valid(rows: list[Row]) -> str:
    """Return the number of valid plans as text; empty if no language model was asked."""
    fallen = sum(row["status"].startswith("fallback") for row in rows)
    asked = fallen or any(row["source"] == "llm" for row in rows)
    return f"{len(rows) - fallen} of {len(rows)} valid" if asked else ""
