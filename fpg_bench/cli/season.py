"""The verbs of ``fpg-bench season``: suites that are trained once all entries are in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import AddressOption, BackendOption, JobsOption, say

app = typer.Typer(help="Close a season, show it, check how it was made.", no_args_is_help=True)
BoardOption = Annotated[Path, typer.Option(help="the leaderboard's folder")]
NameArgument = Annotated[str, typer.Argument(help="a shipped suite (season-1), or its folder")]


@app.command()
def close(
    name: Annotated[str, typer.Argument(help="the season's number, or what a training population is called")],
    work: Annotated[Path, typer.Option(help="a folder for the candidates; a stopped closing goes on there")],
    out: Annotated[
        Path | None, typer.Option(help="the suite's folder; default: baselines/suites/<name>")
    ] = None,
    board: BoardOption = Path("leaderboard"),
    side: Annotated[str | None, typer.Option(help="train candidates of one side only now")] = None,
    candidates: Annotated[int | None, typer.Option(min=1, help="of each side; default: the recipe's")] = None,
    size: Annotated[
        int | None, typer.Option(min=1, help="members of each side; default: the recipe's")
    ] = None,
    jobs: JobsOption = 2,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Close a season: train candidates from a seed that the entries make, and choose the suite from them.

    Example: fpg-bench season close 2 --work runs/season-2
    """
    from fpg_bench.leaderboard.close_season import CANDIDATES, SIZE, close_season, make_closing
    from fpg_bench.players.agent import baselines_folder
    from fpg_bench.players.player import SIDES

    closing = make_closing(name, board, work, candidates or CANDIDATES, size or SIZE)
    season = close_season(
        closing,
        out or baselines_folder() / "suites" / closing.name,
        SIDES if side is None else [side],
        workers=jobs,
        backend=backend,
        address=address,
        say=say,
    )
    if season is not None:
        say(f"{season.name}: closed, hash {season.hash[:16]}, {season.folder}")


@app.command()
def show(name: NameArgument, board: BoardOption = Path("leaderboard")) -> None:
    """Say what a season holds, in words.

    Example: fpg-bench season show season-1
    """
    from fpg_bench.leaderboard.audit_season import describe_season

    for line in describe_season(name, board):
        say(line)


@app.command()
def audit(
    name: NameArgument,
    work: Annotated[Path, typer.Option(help="a folder to train in")],
    board: BoardOption = Path("leaderboard"),
    member: Annotated[
        list[str] | None, typer.Option(help="which to train again; may be said several times")
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="how many of each side, where none is named")] = 2,
    jobs: JobsOption = 2,
) -> None:
    """Train members of a season again, and compare what the entries earn against both.

    Example: fpg-bench season audit season-1 --work runs/audit
    """
    from fpg_bench.leaderboard.audit_season import audit_season
    from fpg_bench.leaderboard.season import load_season, read_entries

    season = load_season(name)
    for audited in audit_season(season, read_entries(board), work, member, count, workers=jobs, say=say):
        policies = "the same policy" if audited.is_same else "another policy"
        say(
            f"{audited.side}/{audited.name}: {policies}; entries earn {audited.difference:.2f} per step "
            f"more or less, correlation {audited.correlation:.3f}"
        )
