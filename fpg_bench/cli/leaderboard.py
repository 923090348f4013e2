"""The verbs of ``fpg-bench leaderboard``: building the site, and showing it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import say
from fpg_bench.extras import need

app = typer.Typer(help="Build and show the leaderboard's site.", no_args_is_help=True)
SITE = Path("leaderboard/site")


@app.command()
def build(
    out: Annotated[Path, typer.Option(help="the site's folder")] = SITE,
    folder: Annotated[Path, typer.Option(help="the leaderboard's folder")] = Path("leaderboard"),
    replays: Annotated[
        bool, typer.Option(help="simulate the rounds to watch that are not there; those that are stay")
    ] = True,
    docs: Annotated[
        str,
        typer.Option(
            help="where the documentation's site is, from OUT; default: its rules stand in the site"
        ),
    ] = "",
) -> None:
    """Write the site: it needs no network and no server.

    Example: fpg-bench leaderboard build
    """
    need("leaderboard", "jinja2")
    from rich.progress import Progress

    from fpg_bench.leaderboard.board import make_board
    from fpg_bench.leaderboard.planner_marks import marked
    from fpg_bench.leaderboard.secrets import forget_keys
    from fpg_bench.leaderboard.site.build import build_site, check_folder
    from fpg_bench.leaderboard.site.replays import make_replays
    from fpg_bench.leaderboard.site.rivals import submitted_policies

    forget_keys()
    check_folder(out)
    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("ranks", total=None)
        left: list[str] = []
        board = marked(make_board(folder, left.append), folder)

        def show(name: str) -> None:
            bar.update(task, description=name)

        rounds = make_replays(board, folder, out, show, simulate=replays)
        files = build_site(board, out, rounds, show, docs, submitted_policies(board, folder))
    for line in left:
        say(line)
    entries = sum(len(track["rows"]) for track in board["tracks"])
    shown = sum(map(len, rounds.values()))
    say(f"{entries} entries, {shown} rounds to watch, {len(files)} files: open {out / 'index.html'}")


@app.command()
def serve(
    site: Annotated[Path, typer.Argument(help="the site's folder")] = SITE,
    port: Annotated[int, typer.Option(min=0, max=65535, help="of this machine; 0: any that is free")] = 8000,
) -> None:
    """Show a built site on this machine, until Ctrl-C.

    Example: fpg-bench leaderboard serve --port 8000
    """
    import signal

    from fpg_bench.leaderboard.site.serve import HOST, make_server

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
    with make_server(site, port) as server:
        try:
            say(f"http://{HOST}:{server.server_port}/ (Ctrl-C ends it)")
            server.serve_forever()
        except KeyboardInterrupt:
            say("stopped")
