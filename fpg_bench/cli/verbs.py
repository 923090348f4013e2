"""The verbs of the command line: thin over the library."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fpg_bench.cli.options import (
    AddressOption,
    BackendOption,
    CallsOption,
    DeadlineOption,
    JobsOption,
    PathOption,
    PlannerOption,
    PromptOption,
    ScenarioOption,
    SecondsOption,
    ServerOption,
    TokensOption,
    listed,
    llm_options,
    say,
    steps_option,
)
from fpg_bench.errors import UserError

if TYPE_CHECKING:
    from fpg_bench.training.run_folder import RunFolder


def envs() -> None:
    """List the environment ids, what they default to, and their spaces."""
    from fpg_bench.ids import VIEWS

    for view in VIEWS.values():
        flown = f"planned by {view.planner}" if view.planner else view.path
        typer.echo(f"{view.id}\n    {view.about}")
        typer.echo(
            f"    you play: {view.side}; {view.other_side}: {view.other}; opponent's path: {flown}; "
            f"rounds a match: {view.rounds_per_match}"
        )
    typer.echo("Both sides at once: fpg_bench.make_duel(n), and FPG/duel_v0 in PettingZoo's registry.")
    typer.echo(
        "Observations: 15 numbers in [-1, 1]. Actions: 9 numbers in [-1, 1]. A round: 300 steps of 1 s."
    )


def play(
    ally: Annotated[str, typer.Option(help="the ally's player")] = "expert",
    opponent: Annotated[str, typer.Option(help="the opponent's player")] = "adaptive",
    scenario: ScenarioOption = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    seed: Annotated[int, typer.Option(help="decides the match")] = 0,
    every: Annotated[int, typer.Option(min=1, help="print every n-th step")] = 10,
    out: Annotated[Path | None, typer.Option(help="write .html, .gif or .mp4 instead of text")] = None,
    overwrite: Annotated[bool, typer.Option(help="replace a file that is there already")] = False,
) -> None:
    """Watch one round of a pairing: as text, a film, or an interactive page."""
    from fpg_bench.envs.watching import watch

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
    view_id: Annotated[str, typer.Argument(metavar="ID", help="FPG/AllyVsScripted-v0 and the like")],
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
    panel: Annotated[
        str | None, typer.Option(help="what scores the policy on the way; default: the id's panel")
    ] = None,
    evaluations: Annotated[int, typer.Option(min=0, help="how many times; 0: never")] = 20,
    against: Annotated[
        str | None, typer.Option(help="the other side's player, whichever side; several, separated by commas")
    ] = None,
    start: Annotated[
        Path | None, typer.Option(help="a finished run of yours, whose weights this one begins with")
    ] = None,
    scenario: ScenarioOption = None,
    opponent: Annotated[str | None, typer.Option(help="against whom; several, separated by commas")] = None,
    ally: Annotated[str | None, typer.Option(help="against whom; several, separated by commas")] = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    transcript: Annotated[
        Path | None, typer.Option(help="fly the plans of another run's language model, without a server")
    ] = None,
    knowledge: Annotated[str | None, typer.Option(help="expert, none or a YAML file")] = None,
    jamming_types: Annotated[str | None, typer.Option(help="allowed types, separated by commas")] = None,
    reward: Annotated[
        str | None, typer.Option(help="own, or against: minus the other side's; default: own")
    ] = None,
    prompt: PromptOption = None,
    server: ServerOption = None,
    calls: CallsOption = None,
    tokens: TokensOption = None,
    seconds: SecondsOption = None,
    deadline: DeadlineOption = None,
) -> None:
    """Train an algorithm of Stable-Baselines3's kind on an id and export the agent."""
    from fpg_bench.training.run_folder import RunFolder
    from fpg_bench.training.several import parse_seeds, train_seeds
    from fpg_bench.training.train import train as train_run

    words: dict[str, Any] = {
        "steps": steps,
        "hyperparams": hyperparams,
        "panel": panel,
        "evaluations": evaluations,
        "restart": restart,
        "transcript": transcript,
        "llm": llm_options(
            deadline, prompt=prompt, server=server, calls=calls, tokens=tokens, seconds=seconds
        ),
        "against": listed(against),
        "start": start,
        "scenario": scenario,
        "opponent": listed(opponent),
        "ally": listed(ally),
        "path": listed(path),
        "planner": planner,
        "knowledge": knowledge,
        "jamming_types": listed(jamming_types),
        "reward": reward,
    }
    if seeds is None and (backend, address) != ("loky", None):
        raise UserError("backend, address: are for a list of runs; name its --seeds")
    if seed is not None and seeds is not None:
        raise UserError("seed, seeds: say one of them")
    if seeds is not None:
        where: dict[str, Any] = {"workers": jobs, "backend": backend, "address": address}
        listed_seeds = parse_seeds(seeds)
        train_seeds(algorithm, view_id, out, listed_seeds, **where, say=say, **words)
        for each in listed_seeds:
            print_scores(RunFolder(out / f"seed_{each}"), f"seed {each}: ")
        typer.echo(f"agents: {out}/seed_*/agent\nlearning curves: tensorboard --logdir {out}")
        return
    folder = RunFolder(out)
    already = folder.is_finished()
    try:
        agent = train_run(algorithm, view_id, out, seed=seed or 0, resume=resume, **words)
    except KeyboardInterrupt as stop:
        saved = str(stop) or "the last checkpoint is kept"
        typer.echo(f"{saved}; go on by the same command with --resume", err=True)
        raise
    if already:
        typer.echo("this run was finished before; nothing was trained")
    print_scores(folder)
    typer.echo(f"agent: {agent}\nlearning curves: tensorboard --logdir {out}")


def print_scores(run: RunFolder, head: str = "") -> None:
    """Print what the policy of each side scored at the end of a run; nothing where it was never scored."""
    for side, score in run.last_scores().items():
        shown = "none" if score is None else f"{score:.1f}"
        typer.echo(f"{head}{side}'s score at the end of training (few rounds, tuning seeds): {shown}")


def evaluate(
    players: Annotated[
        list[str], typer.Argument(help="scripts, agent folders, shipped agents, or all-scripted")
    ],
    panel: Annotated[str, typer.Option(help="a panel's name or YAML file")] = "ally-v1",
    out: Annotated[Path, typer.Option(help="the results folder")] = Path("results"),
    rounds: Annotated[
        int | None, typer.Option(help="rounds per entry, 500 at most; default: the panel's")
    ] = None,
    name: Annotated[str | None, typer.Option(help="what the table calls the agents named")] = None,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Play players against a panel; rows that are in the folder already are not played again."""
    from rich.progress import Progress

    from fpg_bench.evaluation.evaluate import evaluate as evaluate_players

    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=None)
        evaluate_players(
            players,
            panel,
            out,
            rounds=rounds,
            name=name,
            progress=lambda who, entry: bar.update(task, description=f"{who.name} - {entry.name}"),
            jobs=jobs,
            backend=backend,
            address=address,
            say=lambda line: bar.update(task, description=line),
        )
    table(out)


def measure_panel(
    panel: Annotated[str, typer.Argument(help="a panel's name or YAML file")],
    rounds: Annotated[
        int | None, typer.Option(help="rounds per entry, 500 by default; a panel of planners has its own")
    ] = None,
) -> None:
    """Measure the scores that normalise a panel and write them beside its file."""
    from fpg_bench.evaluation.panel import compares_planners
    from fpg_bench.evaluation.planner_references import measure_planner_panel
    from fpg_bench.evaluation.references import ROUNDS
    from fpg_bench.evaluation.references import measure_panel as measure

    if compares_planners(panel):
        if rounds is not None:
            raise UserError(f"rounds: panel {panel} says itself how many matches and rounds it plays")
        measure_planner_panel(panel, lambda planner, ally: typer.echo(f"{ally:24} {planner}"))
        return
    measure(
        panel,
        ROUNDS if rounds is None else rounds,
        lambda entry, found: typer.echo(
            f"{entry.name:24} reference {found.standard_errors:6.1f} standard errors above random"
        ),
    )


def table(folder: Annotated[Path, typer.Argument(help="a results folder")]) -> None:
    """Print a results folder's table, and write it there as Markdown, CSV and a picture."""
    from fpg_bench.evaluation import table as tables
    from fpg_bench.evaluation.evaluate import read_results

    summaries, panel = read_results(folder)
    tables.write_table(summaries, panel, folder)
    lines = [tables.cells(summary, panel.side) for summary in summaries]
    print_results(tables.headings(panel.side), lines, tables.caption(panel), folder)


def print_results(names: list[str], lines: list[list[str]], below: str, folder: Path) -> None:
    """Print a results folder's table, its caption, and what was written."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    drawn = Table(*names, box=box.SIMPLE_HEAD, caption=below)
    for line in lines:
        drawn.add_row(*line)
    console = Console()
    console.print(drawn) if console.width >= 160 else Console(width=200).print(drawn)
    console.print(f"written: {folder}/table.md, table.csv, table.png")
