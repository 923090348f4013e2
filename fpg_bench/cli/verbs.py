"""The verbs of the command line: thin over the library."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.options import (
    AddressOption,
    BackendOption,
    CallsOption,
    DeadlineOption,
    JobsOption,
    PathOption,
    PlannerOption,
    PlayerOption,
    PlayersOption,
    PromptOption,
    ScenarioOption,
    SecondsOption,
    ServerOption,
    TokensOption,
    WideOption,
    listed,
    llm_options,
    say,
    steps_option,
)
from fpg_bench.common.errors import UserError, printable

if TYPE_CHECKING:
    from fpg_bench.training.run_folder import RunFolder


def play(
    ally: PlayerOption = "expert",
    opponent: PlayerOption = "adaptive",
    scenario: ScenarioOption = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    seed: Annotated[int, typer.Option(help="decides the match")] = 0,
    every: Annotated[int, typer.Option(min=1, help="print every n-th step")] = 10,
    out: Annotated[Path | None, typer.Option(help="write .html, .gif or .mp4 instead of text")] = None,
    overwrite: Annotated[bool, typer.Option(help="replace a file that is there already")] = False,
) -> None:
    """Watch one round of a pairing: as text, a film, or an interactive page.

    Example: fpg-bench play --ally expert-spread --opponent adaptive --seed 12
    """
    from fpg_bench.evaluation.watching import watch

    watch(
        ally,
        opponent,
        scenario=scenario,
        path=listed(path),
        planner=planner,
        seed=seed,
        out=out,
        every=every,
        overwrite=overwrite,
    )


def train(
    algorithm: Annotated[
        str,
        typer.Argument(
            help="ppo, ppo-fast, ppo-stack8, recurrent-ppo, sac, td3, maddpg, or package.module:Class"
        ),
    ],
    env_id: Annotated[str, typer.Argument(metavar="ID", help="FPG/AllyVsScripted-v0 and the like")],
    out: Annotated[Path, typer.Option(help="the run's folder")],
    resume: Annotated[bool, typer.Option("--resume", help="go on with an unfinished run")] = False,
    restart: Annotated[bool, typer.Option("--restart", help="begin an unfinished run again")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="training seed; default: 0")] = None,
    seeds: Annotated[
        str | None, typer.Option(help="several, 0-4 or 0,2,5: each into OUT/seed_k; stopped, they go on")
    ] = None,
    jobs: JobsOption = 2,
    backend: BackendOption = "loky",
    address: AddressOption = None,
    steps: Annotated[
        int | None, steps_option("budget, 2e6 for instance; default: the hyper-parameter file's")
    ] = None,
    hyperparams: Annotated[Path | None, typer.Option(help="a YAML file of your own")] = None,
    suite: Annotated[
        str | None, typer.Option(help="what scores the policy on the way; default: the id's suite")
    ] = None,
    evaluations: Annotated[int, typer.Option(min=0, help="how many times; 0: never")] = 20,
    against: Annotated[str | None, typer.Option(help="as --opponent or --ally, whichever side it is")] = None,
    start: Annotated[
        Path | None, typer.Option(help="a finished run of yours, whose weights this one begins with")
    ] = None,
    scenario: ScenarioOption = None,
    opponent: PlayersOption = None,
    ally: PlayersOption = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    transcript: Annotated[
        Path | None, typer.Option(help="fly the plans of another run's language model, without a server")
    ] = None,
    knowledge: Annotated[str | None, typer.Option(help="expert, none or a YAML file")] = None,
    jamming_types: Annotated[str | None, typer.Option(help="allowed types, separated by commas")] = None,
    reward: Annotated[
        str | None, typer.Option(help="own (default), against, jamming, overlap or spending")
    ] = None,
    prompt: PromptOption = None,
    server: ServerOption = None,
    calls: CallsOption = None,
    tokens: TokensOption = None,
    seconds: SecondsOption = None,
    deadline: DeadlineOption = None,
) -> None:
    """Train an algorithm of Stable-Baselines3's kind on an id and export the agent.

    Example: fpg-bench train ppo FPG/AllyVsScripted-v0 --steps 2e6 --out runs/ppo_0
    """
    from fpg_bench.training.config import GameOptions, RunConfig
    from fpg_bench.training.run_folder import RunFolder
    from fpg_bench.training.train import parse_seeds, train_seeds
    from fpg_bench.training.train import train as train_run

    game = GameOptions(
        scenario=scenario,
        opponent=listed(opponent),
        ally=listed(ally),
        path=listed(path),
        planner=planner,
        knowledge=knowledge,
        jamming_types=listed(jamming_types),
        reward=reward,
    )
    llm = llm_options(deadline, prompt=prompt, server=server, calls=calls, tokens=tokens, seconds=seconds)
    config = RunConfig(
        algorithm,
        env_id,
        seed or 0,
        steps,
        hyperparams,
        game,
        suite=suite,
        against=listed(against),
        start=start,
        transcript=transcript,
        llm=llm,
    )
    if seeds is None and (backend, address) != ("loky", None):
        raise UserError("backend, address: are for a list of runs; name its --seeds")
    if seed is not None and seeds is not None:
        raise UserError("seed, seeds: say one of them")
    if seeds is not None:
        listed_seeds = parse_seeds(seeds)
        train_seeds(
            config,
            out,
            listed_seeds,
            evaluations=evaluations,
            restart=restart,
            workers=jobs,
            backend=backend,
            address=address,
            say=say,
        )
        for each in listed_seeds:
            print_scores(RunFolder(out / f"seed_{each}"), f"seed {each}: ")
        typer.echo(f"agents: {out}/seed_*/agent\nall curves: tensorboard --logdir {out}")
        return
    folder = RunFolder(out)
    already = folder.is_finished()
    try:
        agent = train_run(config, out, evaluations=evaluations, resume=resume, restart=restart)
    except KeyboardInterrupt as stop:
        kept = "the last checkpoint is kept" if folder.has_checkpoint() else "no step is saved yet"
        saved = str(stop) or kept
        typer.echo(f"{saved}; go on by the same command with --resume", err=True)
        raise
    if already:
        typer.echo("this run was finished before; nothing was trained")
    print_scores(folder)
    if folder.curve.exists():
        typer.echo(f"learning curve: {folder.curve}")
    typer.echo(f"agent: {agent}\nall curves: tensorboard --logdir {out}")


def print_scores(run: RunFolder, head: str = "") -> None:
    """Print what the policy of each side scored at the end of a run; nothing where it was never scored."""
    for side, score in run.last_scores().items():
        shown = "none" if score is None else f"{score:.1f}"
        typer.echo(f"{head}{side}'s score at the end of training (few rounds, tuning seeds): {shown}")


def evaluate(
    players: Annotated[
        list[str], typer.Argument(help="scripts, agent folders, shipped agents, or all-scripted")
    ],
    suite: Annotated[str, typer.Option(help="a suite's name or YAML file")] = "ally-v1",
    out: Annotated[Path, typer.Option(help="the results folder")] = Path("results"),
    matches: Annotated[int | None, typer.Option(help="matches per rival; default: the suite's")] = None,
    name: Annotated[str | None, typer.Option(help="what the table calls the agents named")] = None,
    wide: WideOption = False,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Play players against a suite; what is in the folder already is not played again.

    Example: fpg-bench evaluate runs/ppo_0/agent all-scripted --suite ally-v1 --out results/mine
    """
    from fpg_bench.evaluation.evaluate import evaluate as evaluate_players

    with shown_progress() as show:
        evaluate_players(
            players,
            suite,
            out,
            matches=matches,
            name=name,
            progress=lambda entry, rival, rounds: show(f"{entry.name} - {rival.name}"),
            jobs=jobs,
            backend=backend,
            address=address,
            say=show,
        )
    table(out, wide)


def table(folder: Annotated[Path, typer.Argument(help="a results folder")], wide: WideOption = False) -> None:
    """Print a results folder's table, and write it there as Markdown, CSV and a picture.

    Example: fpg-bench table results/mine --wide
    """
    from fpg_bench.evaluation import table as tables
    from fpg_bench.evaluation.evaluate import read_results

    summaries, suite = read_results(folder)
    tables.write_table(summaries, suite, folder)
    width = None if wide else terminal_width()
    head, *lines = tables.lines_of_table(summaries, suite, width)
    print_table(head, lines, tables.caption(suite))
    typer.echo(f"written: {folder}/table.md, table.csv, table.png")


@contextlib.contextmanager
def shown_progress() -> Iterator[Callable[[str], None]]:
    """Something to tell what is under way: it draws it on a terminal, and else prints it now and then."""
    from rich.progress import Progress

    from fpg_bench.common.parallel import LINE_EVERY_S

    told = time.monotonic()
    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=None)

        def show(line: str) -> None:
            nonlocal told
            bar.update(task, description=line)
            if bar.disable and time.monotonic() - told >= LINE_EVERY_S:
                told = time.monotonic()
                print(printable(line), file=sys.stderr, flush=True)

        yield show


def terminal_width() -> int:
    """How many characters a line of the terminal has; 80 where there is none."""
    from rich.console import Console

    return Console().width


def print_table(names: list[str], lines: list[list[str]], below: str) -> None:
    """Print a table, whole however narrow the terminal is, and its caption."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    drawn = Table(*names, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for line in lines:
        drawn.add_row(*line)
    width = terminal_width()
    wide = Console(width=max(width, 1000))
    Console(width=max(width, wide.measure(drawn).maximum)).print(drawn)
    Console(width=width, highlight=False).print(below)
