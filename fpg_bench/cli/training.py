"""The verbs of training: ``train`` and ``export``."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.fields import Given, listed
from fpg_bench.cli.options import (
    EVALUATION,
    GAME,
    OUTPUT,
    TRAINING,
    WorkersOption,
    complete_algorithm,
    complete_id,
    game_options,
    llm_options,
    other_game_options,
    print_wrapped,
    run_options,
)
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_writable
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Workers, load_ahead
from fpg_bench.common.products import load
from fpg_bench.game.spec import other_game
from fpg_bench.training.algorithms import ALGORITHMS, JOINT
from fpg_bench.training.config import LOADED, N_EVALS, RunConfig

if TYPE_CHECKING:
    from fpg_bench.training.run_folder import RunFolder

ZOO = "zoo"  # value of --against
ZIP = "Stable-Baselines3 zip"


RunOption = Annotated[Path, typer.Option(help="Folder of the run.", rich_help_panel=OUTPUT)]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Continue an unfinished run.", rich_help_panel=OUTPUT)
]
RestartOption = Annotated[
    bool,
    typer.Option("--restart", help="Discard an unfinished run and start over.", rich_help_panel=OUTPUT),
]
SeedOption = Annotated[
    int | None, typer.Option(min=0, help="Training seed. Default: 0.", rich_help_panel=TRAINING)
]
SeedsOption = Annotated[
    str | None,
    typer.Option(
        help="Training seeds of several runs, 0-4 or 0,2,5; the folder of each run is OUT/seed_<k>.",
        rich_help_panel=TRAINING,
    ),
]
EvaluationsOption = Annotated[
    int,
    typer.Option(
        min=0, help="Number of evaluations during training; 0 for none.", rich_help_panel=EVALUATION
    ),
]


def train(
    algorithm: Annotated[
        str,
        typer.Argument(
            help=f"{', '.join((*ALGORITHMS, *JOINT))}, or package.module:Class.",
            autocompletion=complete_algorithm,
        ),
    ],
    env_id: Annotated[
        str,
        typer.Argument(
            metavar="ID", help="The environment id (see fpg-bench envs).", autocompletion=complete_id
        ),
    ],
    out: RunOption,
    resume: ResumeOption = False,
    restart: RestartOption = False,
    seed: SeedOption = None,
    seeds: SeedsOption = None,
    n_evals: EvaluationsOption = N_EVALS,
    against: Annotated[
        str | None,
        typer.Option(
            help="The other side's player, in place of --opponent or --ally; zoo: the players and paths that "
            "the shipped agents of this id were trained against.",
            rich_help_panel=GAME,
        ),
    ] = None,
    *,
    run: Annotated[Given, run_options("steps", "hyperparams", "start", "suite", "allow")],
    game: Annotated[Given, game_options()],
    team: Annotated[Given, other_game_options()],
    workers: WorkersOption = Workers(2),
    planner_options: Annotated[Given, llm_options("train")],
) -> None:
    """Train an algorithm on an environment and export the agent.

    Example: fpg-bench train ppo FPG/AllyVsScripted-v0 --steps 2e6 --out runs/ppo_0
    """
    check_writable(out)  # before the seconds that the imports take
    from fpg_bench.game.spec import GameSpec

    from_zoo = against == ZOO and not {"opponent", "ally"} & set(game)
    spec = GameSpec.of(env_id, against=None if from_zoo else listed(against), **game, **team)
    if from_zoo:
        spec = load("agent", ZOO)(spec)
    config = RunConfig(algorithm, spec, seed or 0, planner_options=planner_options, **run)
    if seeds is None and workers.backend != "loky":
        raise UserError("backend: needs several runs; list their --seeds")
    if seeds is not None:
        load_ahead(workers, LOADED)  # while the imports below take seconds, too
    train_runs(config, out, seed, seeds, n_evals, resume, restart, workers)


def train_runs(
    config: RunConfig,
    out: Path,
    seed: int | None,
    seeds: str | None,
    n_evals: int,
    resume: bool,
    restart: bool,
    workers: Workers,
) -> None:
    """Train one run, or one for each of several seeds, and print the scores and files."""
    from fpg_bench.training.run_folder import RunFolder
    from fpg_bench.training.train import parse_seeds, train_seeds
    from fpg_bench.training.train import train as train_run

    if seed is not None and seeds is not None:
        raise UserError("seed, seeds: give only one of them")
    if resume and seeds is None and not (out / "run.json").exists():
        raise UserError(f"resume: {out} holds no run; omit --resume to start one there")
    listed_seeds = [] if seeds is None else parse_seeds(seeds)
    folders = [RunFolder(out / f"seed_{each}") for each in listed_seeds] or [RunFolder(out)]
    if n_evals and not all(folder.is_finished() for folder in folders):
        print_unmet(config)
    if seeds is not None:
        train_seeds(config, out, listed_seeds, evaluations=n_evals, restart=restart, workers=workers)
        for each, folder in zip(listed_seeds, folders, strict=True):
            print_scores(folder, f"seed {each}: ")
        if (curve := RunFolder(out).curve).exists():
            typer.echo(f"learning curve: {curve}")
        typer.echo(f"agents: {out}/seed_*/agent\nall curves: tensorboard --logdir {shlex.quote(str(out))}")
        return
    (folder,) = folders
    already = folder.is_finished()
    try:
        agent = train_run(config, out, evaluations=n_evals, resume=resume, restart=restart)
    except KeyboardInterrupt as stop:
        kept = "the last checkpoint is kept" if folder.has_checkpoint() else "no step is saved yet"
        saved = str(stop) or kept
        typer.echo(f"{saved}; add --resume to the same command to continue", err=True)
        raise
    if already:
        typer.echo("this run was already finished; nothing was trained")
    print_scores(folder)
    if folder.curve.exists():
        typer.echo(f"learning curve: {folder.curve}")
    typer.echo(f"agent: {agent}\nall curves: tensorboard --logdir {shlex.quote(str(out))}")


def print_unmet(config: RunConfig) -> None:
    """Print which rivals of the suite that scores a training the training never meets."""
    from fpg_bench.evaluation.suite import read_suite

    if config.dataset is not None or config.spec.is_duel or other_game(config.spec) is not None:
        return
    (name,) = config.suites()
    paths, players = {*config.spec.resolve().paths}, {*map(str, config.spec.others)}
    rivals = read_suite(name).rivals
    unmet = [
        each.name for each in rivals if not (paths & {*each.scenario.paths} and players & {*each.players})
    ]
    if unmet:
        print_wrapped(
            f"{name}: {len(unmet)} of its {len(rivals)} rivals are never met here: {', '.join(unmet)}"
        )


def print_scores(run: RunFolder, head: str = "") -> None:
    """Print the last score of each side's policy in a run; print nothing if it was never evaluated."""
    if not (scores := run.last_scores()):
        return
    from fpg_bench.evaluation.suite import read_suite

    about = run.read()
    suites = [read_suite(name) for name in (about.suite or "").split(", ")]
    on = {suite.side: suite.name for suite in suites}
    other = {suite.side: suite.name for suite in suites if not suite.is_of(about.played)}
    for side, score in scores.items():
        shown = "none" if score is None else f"{score:.1f}"
        what = (
            f"return per step against {other[side]} in the run's scenario"
            if side in other
            else f"score on {on[side]}"
        )
        typer.echo(f"{head}{side}'s {what} at the end of training (few rounds, tuning seeds): {shown}")


def export(
    source: Annotated[
        Path,
        typer.Argument(help="Folder of a run or of seed_0, seed_1, ..., or a zip written by save() of SB3."),
    ],
    out: Annotated[
        Path,
        typer.Option(help="Folder of the agent, <submission>/seed_<k>; for several seeds, <submission>."),
    ],
    side: Annotated[
        str | None, typer.Option(help="For a run that trained both sides: ally or opponent.")
    ] = None,
    algo: Annotated[
        str | None, typer.Option(help="For a zip: ppo, a2c, sac or td3.", rich_help_panel=ZIP)
    ] = None,
    env_id: Annotated[
        str | None,
        typer.Option(
            "--id",
            help="For a zip: the environment id. Default: that of the run whose folder it is in.",
            autocompletion=complete_id,
            rich_help_panel=ZIP,
        ),
    ] = None,
    *,
    game: Annotated[Given, dataclasses.replace(game_options("scenario", "path", "actions"), panel=ZIP)],
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="For a zip: the training seed. Default: taken from the folder's name.",
            rich_help_panel=ZIP,
        ),
    ] = None,
    not_normalized: Annotated[
        bool,
        typer.Option(
            "--not-normalized", help="For a zip: it was trained without VecNormalize.", rich_help_panel=ZIP
        ),
    ] = False,
) -> None:
    """Export a trained model as an agent folder, and compare the agent with the model's predict().

    A folder with the runs of several training seeds (train --seeds) is exported as one agent per seed.

    Example: fpg-bench export runs/ppo_0 --out leaderboard/submissions/ally/my-agent/seed_0
    """
    from fpg_bench.training.run import check_free, export_runs

    with locked(out):
        if source.is_dir():
            exported = export_runs(source, out, side)
        else:
            from fpg_bench.game.spec import GameSpec

            check_free(out)
            if game and env_id is None:
                raise UserError(f"{next(iter(game))}: is of the game of --id, which is not given")
            export_zip = load("agent", ".zip")
            spec = None if env_id is None else GameSpec.of(env_id, **game)
            exported = {out: export_zip(source, out, algo, spec, seed, is_plain=not_normalized)}
    for agent, difference in exported.items():
        shown = "unknown" if difference is None else f"{difference:.2g}"
        typer.echo(f"agent: {agent}\nlargest difference from predict(): {shown}")
