"""The verbs of ``fpg-bench submit``, what a submission is worth, and of ``leaderboard``, the site."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.cli.options import AddressOption, BackendOption, JobsOption, say
from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import need

submit = typer.Typer(help="Check and verify submissions to the leaderboard.", no_args_is_help=True)
leaderboard = typer.Typer(help="Build and show the leaderboard's site.", no_args_is_help=True)
SITE = Path("leaderboard/site")
UpdateOption = Annotated[
    bool, typer.Option("--update", help="play anew, and replace, results that do not fit or were edited")
]
SinceOption = Annotated[
    str | None,
    typer.Option(help="a git revision that is trusted: what is new since is played whole, and replaced"),
]
ChangesKnownOption = Annotated[
    bool, typer.Option("--changes-known", help="with --since: you have read the other files that changed")
]
FolderOption = Annotated[Path, typer.Option(help="the leaderboard's folder")]


@submit.callback()
def _forget() -> None:
    """Check and verify submissions to the leaderboard."""
    from fpg_bench.leaderboard.sandbox import forget_keys

    forget_keys()


@submit.command()
def check(folder: Annotated[Path, typer.Argument(help="the submission's folder")]) -> None:
    """Say what is wrong with a submission, line by line, and try its policies in a few rounds.

    A note is no fault.

    Example: fpg-bench submit check leaderboard/submissions/ally/my-agent
    """
    from fpg_bench.leaderboard.playing import smoke_test, suites_of
    from fpg_bench.leaderboard.submission import load_submission, notes, problems
    from fpg_bench.leaderboard.tracks import PUBLIC, TrackSuites

    found = problems(folder)
    if not found:
        submission = load_submission(folder)
        suite = suites_of(submission, TrackSuites())[PUBLIC]
        for policy in submission.policies:
            found += [f"seed_{policy.seed}: {line}" for line in smoke_test(policy, suite)]
        for line in notes(submission):
            say(f"{folder}: note: {line}")
    for line in found:
        say(f"{folder}: {line}")
    if found:
        raise typer.Exit(1)
    say(f"{folder}: nothing is wrong")


@submit.command()
def run(
    folder: Annotated[Path, typer.Argument(help="<leaderboard>/submissions/<track>/<name>")],
    update: UpdateOption = False,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Play a submission and write its result; where it has one, play again and compare.

    Example: fpg-bench submit run leaderboard/submissions/ally/my-agent
    """
    from fpg_bench.leaderboard.verification import run_one

    verdict = run_one(folder, update, jobs=jobs, backend=backend, address=address, say=say)
    raise typer.Exit(0 if verdict.good else 1)


@submit.command()
def verify(
    names: Annotated[list[str] | None, typer.Argument(help="track/name; none: all")] = None,
    folder: FolderOption = Path("leaderboard"),
    sample: Annotated[
        str | None,
        typer.Option(help="play again only so many lines, drawn at random, as 5%; one of each at least"),
    ] = None,
    sample_seed: Annotated[
        int | None, typer.Option(help="of the draw; default: a new one, which is said")
    ] = None,
    update: UpdateOption = False,
    since: SinceOption = None,
    changes_known: ChangesKnownOption = False,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Play submissions again and compare with their results; write those that are missing.

    Example: fpg-bench submit verify --sample 5%
    """
    from fpg_bench.leaderboard.verification import verify as verify_all

    verdicts = verify_all(
        folder,
        names or (),
        sample=None if sample is None else _share(sample),
        sample_seed=sample_seed,
        update=update,
        since=since,
        changes_known=changes_known,
        jobs=jobs,
        backend=backend,
        address=address,
        say=say,
    )
    bad = sum(not verdict.good for verdict in verdicts)
    say(f"{len(verdicts)} verdicts, {bad} bad" if bad else f"{len(verdicts)} verdicts, all good")
    raise typer.Exit(1 if bad else 0)


@submit.command()
def crossplay(
    folder: FolderOption = Path("leaderboard"),
    check: Annotated[
        str | None, typer.Option(help="play so many of the pairs again, as 5%, instead of those that lack")
    ] = None,
    sample_seed: Annotated[int, typer.Option(help="of the draw")] = 0,
    since: SinceOption = None,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Play every verified ally against every opponent, where that was not done yet.

    Example: fpg-bench submit crossplay
    """
    from fpg_bench.leaderboard.changed_entries import pairs_at
    from fpg_bench.leaderboard.crossplay import check_pairs, play_missing

    trusted = None if since is None else pairs_at(folder, since)
    if check is None:
        where: dict[str, Any] = {"jobs": jobs, "backend": backend, "address": address}
        failed = play_missing(folder, trusted=trusted, say=say, **where)
    else:
        failed = check_pairs(folder, _share(check), sample_seed)
    for line in failed:
        say(line)
    raise typer.Exit(1 if failed else 0)


def _share(text: str) -> float:
    """The share that a percentage says, as ``5%``."""
    try:
        return float(text.strip().removesuffix("%")) / 100
    except ValueError:
        raise UserError(f"expected a percentage as 5%, got {text!r}") from None


@leaderboard.command()
def build(
    out: Annotated[Path, typer.Option(help="the site's folder")] = SITE,
    folder: FolderOption = Path("leaderboard"),
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
    from fpg_bench.leaderboard.sandbox import forget_keys
    from fpg_bench.leaderboard.site.build import build_site, check_folder
    from fpg_bench.leaderboard.site.page_data import submitted_policies
    from fpg_bench.leaderboard.site.replays import make_replays

    forget_keys()
    check_folder(out)
    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("ranks", total=None)
        left: list[str] = []
        board = make_board(folder, left.append)

        def show(name: str) -> None:
            bar.update(task, description=name)

        rounds = make_replays(board, folder, out, show, simulate=replays)
        files = build_site(board, out, rounds, show, docs, submitted_policies(board, folder))
    for line in left:
        say(line)
    entries = sum(len(track.entries) for track in board.tracks)
    shown = sum(map(len, rounds.values()))
    say(f"{entries} entries, {shown} rounds to watch, {len(files)} files: open {out / 'index.html'}")


@leaderboard.command()
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
