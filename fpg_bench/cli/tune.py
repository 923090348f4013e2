"""The verbs of tuning: search, look at it, write down what held."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.cli.options import (
    AddressOption,
    BackendOption,
    JobsOption,
    PathOption,
    PlannerOption,
    PlayersOption,
    ScenarioOption,
    listed,
    say,
    steps_option,
)
from fpg_bench.common.extras import need

Folder = Annotated[Path, typer.Argument(help="the study's folder")]
StorageOption = Annotated[
    str | None, typer.Option(help="a database's URL as Optuna takes it; default: a journal in the folder")
]
NameOption = Annotated[str | None, typer.Option(help="the study's name")]
LostOption = Annotated[list[str] | None, typer.Option(help="a machine that is gone: try its trials again")]
PatienceOption = Annotated[float, typer.Option(min=0, help="seconds to wait for a storage that went down")]


def tune(
    algorithm: Annotated[str, typer.Argument(help="as for train")],
    env_id: Annotated[str, typer.Argument(metavar="ID", help="FPG/AllyVsScripted-v0 and the like")],
    out: Annotated[Path, typer.Option(help="the study's folder")],
    trials: Annotated[int, typer.Option(min=1, help="finished trials, of all workers together")] = 20,
    seeds: Annotated[int, typer.Option(min=1, help="training seeds of a trial")] = 2,
    steps: Annotated[int | None, steps_option("budget of a seed; default: half of the file's")] = None,
    space: Annotated[Path | None, typer.Option(help="a search space of your own, YAML")] = None,
    hyperparams: Annotated[Path | None, typer.Option(help="a YAML file of your own")] = None,
    suite: Annotated[str | None, typer.Option(help="what scores a policy; default: the id's")] = None,
    rounds: Annotated[int, typer.Option(min=1, help="rounds per rival")] = 100,
    storage: StorageOption = None,
    name: NameOption = None,
    lost: LostOption = None,
    patience: PatienceOption = 600,
    scenario: ScenarioOption = None,
    opponent: PlayersOption = None,
    ally: PlayersOption = None,
    path: PathOption = None,
    planner: PlannerOption = None,
    jobs: JobsOption = 1,
    backend: BackendOption = "loky",
    address: AddressOption = None,
) -> None:
    """Search hyper-parameters; run it again to go on, and on as many machines as there are.

    Example: fpg-bench tune ppo FPG/AllyVsScripted-v0 --out runs/tune
    """
    need("tune", "optuna", "plotly")
    from fpg_bench.training.tuning import tune as tuning

    tune_run: Any = partial(tuning.tune_together, workers=jobs, backend=backend, address=address)
    if (jobs, backend, address) == (1, "loky", None):
        tune_run = tuning.tune
    tune_run(
        algorithm,
        env_id,
        out,
        trials=trials,
        seeds=seeds,
        steps=steps,
        space=space,
        hyperparams=hyperparams,
        suite=suite,
        rounds=rounds,
        storage=storage,
        name=name,
        lost=lost or (),
        patience_s=patience,
        say=say,
        scenario=scenario,
        opponent=listed(opponent),
        ally=listed(ally),
        path=listed(path),
        planner=planner,
    )


def tune_report(out: Folder, storage: StorageOption = None, name: NameOption = None) -> None:
    """Write a study's history, importances and slices as a page.

    Example: fpg-bench tune-report runs/tune
    """
    need("tune", "optuna", "plotly")
    from fpg_bench.training.tuning.report import write_report

    typer.echo(f"written: {write_report(out, storage=storage, name=name, say=say)}")


def tune_write(
    out: Folder,
    file: Annotated[Path, typer.Argument(help="the hyper-parameter file")],
    best: Annotated[int, typer.Option(min=1, help="how many trials are trained again")] = 3,
    seeds: Annotated[int, typer.Option(min=1, help="fresh training seeds of each")] = 3,
    steps: Annotated[int | None, steps_option("budget of a seed; default: the study's")] = None,
    storage: StorageOption = None,
    name: NameOption = None,
    lost: LostOption = None,
    patience: PatienceOption = 600,
) -> None:
    """Train a study's best trials again on fresh seeds, and write the best values into a file.

    Example: fpg-bench tune-write runs/tune my_ppo.yml
    """
    need("tune", "optuna", "plotly")
    from fpg_bench.common.errors import UserError
    from fpg_bench.training.tuning.confirm import confirm
    from fpg_bench.training.tuning.write import check_file, shown, write_values

    check_file(file)
    found = confirm(
        out,
        best=best,
        seeds=seeds,
        steps=steps,
        storage=storage,
        name=name,
        lost=lost or (),
        patience_s=patience,
        say=say,
    )
    for confirmed in found:
        score = shown(confirmed.score)
        say(f"trial {confirmed.trial}: {score} on fresh seeds, {confirmed.searched:.1f} in the study")
    if not found:
        raise UserError(f"{out}: no trial was trained on all its fresh seeds; see the lines above")
    write_values(file, found[0])
    say(f"written: {file}, {found[0].task.env_id}")
