"""The command line: thin verbs over the library, one clear line for every error."""

from __future__ import annotations

import errno
import os
import pickle
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.errors import UserError

app = typer.Typer(
    help="Benchmark suite for the UAV frequency point game.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
_DEBUG = False
_STOPPED = 130
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

ScenarioOption = Annotated[str | None, typer.Option(help="standard, paper or a YAML file")]
PathOption = Annotated[str | None, typer.Option(help="how the opponent flies; several, separated by commas")]
PlannerOption = Annotated[str | None, typer.Option(help="who plans the opponent's path between rounds")]


def _print_version(wanted: bool) -> None:
    if wanted:
        from fpg_bench import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option(help="show the traceback of an error")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="print the version", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    global _DEBUG
    _DEBUG = debug


@app.command()
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


@app.command()
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
        path=_listed(path),
        planner=planner,
        seed=seed,
        out=out,
        every=every,
        overwrite=overwrite,
    )


@app.command()
def train(
    algorithm: Annotated[str, typer.Argument(help="ppo, sac or td3")],
    view_id: Annotated[str, typer.Argument(metavar="ID", help="FPG/AllyVsScripted-v0 and the like")],
    out: Annotated[Path, typer.Option(help="the run's folder")],
    restart: Annotated[bool, typer.Option(help="begin an unfinished run again")] = False,
    seed: Annotated[int, typer.Option(min=0, help="training seed")] = 0,
    steps: Annotated[int | None, typer.Option(help="budget; default: the hyper-parameter file's")] = None,
    hyperparams: Annotated[Path | None, typer.Option(help="a YAML file of your own")] = None,
    scenario: ScenarioOption = None,
    opponent: Annotated[str | None, typer.Option(help="against whom; several, separated by commas")] = None,
    ally: Annotated[str | None, typer.Option(help="against whom; several, separated by commas")] = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    knowledge: Annotated[str | None, typer.Option(help="expert, none or a YAML file")] = None,
    jamming_types: Annotated[str | None, typer.Option(help="allowed types, separated by commas")] = None,
) -> None:
    """Train an algorithm of Stable-Baselines3 on an id and export the agent."""
    from fpg_bench.training.train import train as train_run

    agent = train_run(
        algorithm,
        view_id,
        out,
        seed=seed,
        steps=steps,
        hyperparams=hyperparams,
        restart=restart,
        scenario=scenario,
        opponent=_listed(opponent),
        ally=_listed(ally),
        path=_listed(path),
        planner=planner,
        knowledge=knowledge,
        jamming_types=_listed(jamming_types),
    )
    typer.echo(f"agent: {agent}\nlearning curves: tensorboard --logdir {out}")


@app.command()
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
        )
    table(out)


@app.command()
def measure_panel(
    panel: Annotated[str, typer.Argument(help="a panel's name or YAML file")],
    rounds: Annotated[int, typer.Option(help="rounds per entry")] = 500,
) -> None:
    """Measure the scores that normalise a panel and write them beside its file."""
    from fpg_bench.evaluation.references import measure_panel as measure

    measure(
        panel,
        rounds,
        lambda entry, found: typer.echo(
            f"{entry.name:24} reference {found.standard_errors:6.1f} standard errors above random"
        ),
    )


@app.command()
def table(folder: Annotated[Path, typer.Argument(help="a results folder")]) -> None:
    """Print a results folder's table, and write it there as Markdown, CSV and a picture."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from fpg_bench.evaluation import table as tables
    from fpg_bench.evaluation.evaluate import read_results

    summaries, panel = read_results(folder)
    tables.write_table(summaries, panel, folder)
    drawn = Table(*tables.headings(panel.side), box=box.SIMPLE_HEAD, caption=tables.caption(panel))
    for summary in summaries:
        drawn.add_row(*tables.cells(summary, panel.side))
    console = Console()
    console.print(drawn) if console.width >= 160 else Console(width=200).print(drawn)
    console.print(f"written: {folder}/table.md, table.csv, table.png")


def _listed(value: str | None) -> Any:
    """One word, or a list of several that are separated by commas."""
    return value.split(",") if value is not None and "," in value else value


def main() -> None:
    """Run the command line; end with one line and a non-zero status on every error."""
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
        if status == _STOPPED:  # what typer makes of Ctrl-C
            raise KeyboardInterrupt
        sys.exit(status)
    except typer.TyperException as error:  # wrong words on the command line
        message = getattr(error, "format_message", error.__str__)()
        _fail(f"{message} (fpg-bench --help)", 2)
    except (typer.Abort, KeyboardInterrupt):
        _fail("stopped; what was finished is kept", _STOPPED)
    except UserError as error:
        _fail(str(error), 2)
    except (pickle.UnpicklingError, EOFError):
        from fpg_bench.game.compiling import cache_folder

        _fail(f"compiled code on disk is damaged; delete {cache_folder()} and try again", 1)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        full = "; what was finished is kept" if error.errno in _FULL else ""
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}{full}", 1)
    except Exception as error:
        _fail(f"a bug: {type(error).__name__}: {error} (the traceback: fpg-bench --debug ...)", 1)


def _fail(message: str, status: int) -> None:
    if _DEBUG:
        raise
    print("fpg-bench: " + " ".join(message.split()), file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
