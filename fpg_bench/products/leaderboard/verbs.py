"""The verbs of ``fpg-bench submit`` and ``fpg-bench leaderboard``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import with_fields
from fpg_bench.cli.options import WorkersOption, print_wrapped, share
from fpg_bench.common.extras import require_extra
from fpg_bench.common.locks import locked
from fpg_bench.common.output import page, print_line
from fpg_bench.common.parallel import Workers

submit = typer.Typer(help="Check a submission and play it.", no_args_is_help=True)
leaderboard = typer.Typer(
    help="Build the leaderboard's site, verify its results, and close its seasons.", no_args_is_help=True
)
SITE = Path("leaderboard/site")
UpdateOption = Annotated[
    bool, typer.Option("--update", help="Replay and replace results that differ or were edited.")
]
SinceOption = Annotated[
    str | None,
    typer.Option(
        help="A trusted git revision; entries that changed since are played again and replaced, others with "
        "--sample alone."
    ),
]
ChangesKnownOption = Annotated[
    bool,
    typer.Option(
        "--changes-known", help="With --since: confirm that you have reviewed the other changed files."
    ),
]
FolderOption = Annotated[Path, typer.Option(help="Folder of the leaderboard.")]


@leaderboard.callback()
@submit.callback()
def _forget_keys() -> None:
    """Check a submission and play it."""
    from fpg_bench.products.sandbox.process import forget_keys

    forget_keys()


@submit.command()
def check(folder: Annotated[Path, typer.Argument(help="Folder of the submission.")]) -> None:
    """Check a submission's files and try its policies in a few rounds.

    Each fault is printed on one line. Notes do not count as faults.

    Example: fpg-bench submit check leaderboard/submissions/ally/my-agent
    """
    from fpg_bench.products.leaderboard.playing import smoke_test
    from fpg_bench.products.leaderboard.submission import Reader, Refusal, admit, notes

    reader, faults = Reader(), list[str]()
    try:
        submission = admit(folder, reader)
        suite = reader.suites.public(submission.board_track)
        for policy in submission.policies:
            faults += [f"seed_{policy.seed}: {line}" for line in smoke_test(policy, suite)]
        for line in notes(submission):
            print_line(f"{folder}: note: {line}")
    except Refusal as refusal:
        faults += refusal.lines
    for line in faults:
        print_line(f"{folder}: {line}")
    if faults:
        raise typer.Exit(1)
    print_line(f"{folder}: nothing is wrong")


@submit.command()
@with_fields
def run(
    folder: Annotated[
        Path, typer.Argument(help="Folder of the submission, <leaderboard>/submissions/<track>/<name>.")
    ],
    update: UpdateOption = False,
    workers: WorkersOption = Workers(1),
) -> None:
    """Play a submission and write its result, or compare with the existing one.

    Example: fpg-bench submit run leaderboard/submissions/ally/my-agent
    """
    from fpg_bench.products.leaderboard.verification import run_one

    verdict = run_one(folder, update, workers=workers)
    raise typer.Exit(0 if verdict.is_good else 1)


@leaderboard.command()
def init(
    folder: Annotated[Path, typer.Argument(help="Folder of the leaderboard: new or empty.")],
    with_baselines: Annotated[
        bool,
        typer.Option(
            "--with-baselines",
            help="Begin with all entries and results of the benchmark's own board, of the present season.",
        ),
    ] = False,
) -> None:
    """Start a leaderboard of your own, without entries or beside those of the benchmark.

    Put submissions into FOLDER/submissions, play them with fpg-bench submit run, and build the site and its
    browser game with fpg-bench leaderboard build --folder FOLDER.

    Example: fpg-bench leaderboard init leaderboard
    """
    from fpg_bench.products.leaderboard.folders import repository_board, start_board

    start_board(folder, repository_board() if with_baselines else None)
    print_line(
        f"started: {folder}; an entry is a folder in {folder}/submissions/<track>, "
        f"see {page('benchmark/submitting')}"
    )


@leaderboard.command()
@with_fields
def verify(
    names: Annotated[list[str] | None, typer.Argument(help="Entries, track/name. Default: all.")] = None,
    folder: FolderOption = Path("leaderboard"),
    sample: Annotated[
        str | None,
        typer.Option(
            help="Share of records to play again, such as 5%, drawn at random; at least one per entry."
        ),
    ] = None,
    sample_seed: Annotated[
        int | None, typer.Option(help="Seed of the draw. Default: a new one, which is printed.")
    ] = None,
    update: UpdateOption = False,
    since: SinceOption = None,
    changes_known: ChangesKnownOption = False,
    workers: WorkersOption = Workers(1),
) -> None:
    """Play entries, responses to them and pairs again, and compare with their results; write missing ones.

    Pairs are the cross-play of every verified ally with every verified opponent of its scenario.

    Example: fpg-bench leaderboard verify --sample 5%
    """
    import secrets

    from fpg_bench.products.leaderboard.crossplay import verify_pairs
    from fpg_bench.products.leaderboard.encounters import Verification
    from fpg_bench.products.leaderboard.folders import at_work
    from fpg_bench.products.leaderboard.responses import verify_responses
    from fpg_bench.products.leaderboard.verification import verify as verify_entries

    drawn = None if sample is None else share(sample)
    seed = secrets.randbits(32) if sample_seed is None else sample_seed
    how = Verification(names or (), drawn, seed, since, update, workers)
    with at_work(folder):
        verdicts = verify_entries(folder, how, changes_known)
        verdicts += verify_responses(folder, how) + verify_pairs(folder, how)
    bad = sum(not verdict.is_good for verdict in verdicts)
    print_line(f"{len(verdicts)} verdicts, {bad} bad" if bad else f"{len(verdicts)} verdicts, all good")
    raise typer.Exit(1 if bad else 0)


@leaderboard.command("break")
def break_entry(
    entry: Annotated[str, typer.Argument(help="The entry, ally/name.")],
    agent: Annotated[Path, typer.Argument(help="Folder of an opponent's agent.")],
    name: Annotated[str, typer.Option(help="Name of the attacker on the board, such as Tabular search.")],
    author: Annotated[list[str], typer.Option(help="Who made it; can be repeated.")],
    seconds: Annotated[
        float | None, typer.Option(help="CPU seconds of the search. Default: those in agent.json.")
    ] = None,
    folder: FolderOption = Path("leaderboard"),
) -> None:
    """Enter an agent as a response to an entry: check it, and play it against all its training seeds.

    Example: fpg-bench leaderboard break ally/clock runs/table/agent --name "A table" --author "A. Name"
    """
    from fpg_bench.products.leaderboard.folders import at_work
    from fpg_bench.products.leaderboard.responses import enter_response

    about = {"name": name, "authors": author} | ({} if seconds is None else {"seconds": seconds})
    with at_work(folder):
        print_line(enter_response(folder, entry, agent, about))


@leaderboard.command()
def build(
    out: Annotated[Path, typer.Option(help="Folder of the site.")] = SITE,
    folder: FolderOption = Path("leaderboard"),
    replays: Annotated[bool, typer.Option(help="Simulate missing replays; existing ones are kept.")] = True,
    docs: Annotated[
        str, typer.Option(help="URL of the documentation, relative to OUT. Default: where it is published.")
    ] = "",
) -> None:
    """Build the static site; it can be viewed offline.

    Example: fpg-bench leaderboard build
    """
    require_extra("leaderboard", "jinja2")
    from fpg_bench.products.leaderboard.board import make_board
    from fpg_bench.products.leaderboard.entries import load_entries
    from fpg_bench.products.leaderboard.site.build import build_site, check_folder
    from fpg_bench.products.leaderboard.site.page_data import submitted_policies
    from fpg_bench.products.leaderboard.site.replays import make_replays

    check_folder(out)
    with locked(out):
        entries = load_entries(folder)
        rounds = make_replays(entries, out, simulate=replays)
        board = make_board(entries, {key: [replay.file for replay in shown] for key, shown in rounds.items()})
        files = build_site(board, out, rounds, docs, submitted_policies(entries))
    n_entries, n_rounds = len(entries.verified) + len(entries.rejected), sum(map(len, rounds.values()))
    print_line(
        f"{n_entries} entries, {n_rounds} rounds to watch, {len(files)} files: open {out / 'index.html'}"
    )


@leaderboard.command()
@with_fields
def close_season(
    number: Annotated[int, typer.Argument(min=1, help="The season's number.")],
    work: Annotated[Path, typer.Option(help="Folder of the candidates; a stopped closing resumes there.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the suite. Default: baselines/suites/<name>.")
    ] = None,
    folder: FolderOption = Path("leaderboard"),
    side: Annotated[str | None, typer.Option(help="Train candidates of this side only.")] = None,
    scenario: Annotated[
        str, typer.Option(help="The preset whose entries determine the season: standard or link.")
    ] = "standard",
    accept_failures: Annotated[
        bool, typer.Option("--accept-failures", help="Close although a check fails; the season names it.")
    ] = False,
    workers: WorkersOption = Workers(2),
) -> None:
    """Close a season: train candidates with a seed derived from the entries, and select the suite from them.

    Example: fpg-bench leaderboard close-season 5 --work runs/season-5
    """
    require_extra("train", "torch")
    from fpg_bench.players.agent import baselines_folder
    from fpg_bench.players.player import SIDES
    from fpg_bench.products.leaderboard.season import closing as seasons

    closing = seasons.make_closing(number, folder, work, scenario=scenario)
    season = seasons.close_season(
        closing,
        out or baselines_folder() / "suites" / closing.name,
        SIDES if side is None else [side],
        accept_failures=accept_failures,
        workers=workers,
    )
    if season is not None:
        print_line(f"{season.name}: closed, hash {season.hash[:16]}, {season.folder}")


@leaderboard.command()
def season(
    name: Annotated[str, typer.Argument(help="A season, such as season-4, or its folder.")],
    folder: FolderOption = Path("leaderboard"),
) -> None:
    """Describe the members of a season's suites, check its seed, and name the entries that came later.

    Example: fpg-bench leaderboard season season-4
    """
    require_extra("train", "torch")
    from fpg_bench.products.leaderboard.season.audit import describe_season

    for line in describe_season(name, folder):
        print_wrapped(line) if len(line) > 80 else print_line(line)
