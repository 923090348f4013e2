"""The verbs of tuning: search, and export of the best values."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Given, with_fields
from fpg_bench.cli.options import (
    AllowOption,
    WorkersOption,
    complete_algorithm,
    complete_id,
    game_options,
    steps_option,
)
from fpg_bench.common.extras import require_extra
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Workers

app = typer.Typer(help="Tune hyper-parameters with Optuna.")
Folder = Annotated[Path, typer.Argument(help="Folder of the study.")]
StorageOption = Annotated[
    str | None, typer.Option(help="SQLAlchemy URL of a database. Default: SQLite in the folder.")
]
StudyNameOption = Annotated[str | None, typer.Option(help="Name of the study.")]


@app.command()
@with_fields
def run(
    algorithm: Annotated[
        str, typer.Argument(help="The algorithm, as for train.", autocompletion=complete_algorithm)
    ],
    env_id: Annotated[
        str,
        typer.Argument(
            metavar="ID", help="The environment id (see fpg-bench envs).", autocompletion=complete_id
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the study.")],
    n_trials: Annotated[int, typer.Option(min=1, help="Number of finished trials, over all workers.")] = 20,
    timeout: Annotated[
        float | None, typer.Option(min=0, help="Time in seconds after which no new trial starts.")
    ] = None,
    n_seeds: Annotated[int, typer.Option(min=1, help="Number of training seeds of a trial.")] = 2,
    steps: Annotated[
        int | None,
        steps_option("Training budget of a seed. Default: half of the hyper-parameter file's budget."),
    ] = None,
    space: Annotated[Path | None, typer.Option(help="A custom search space, a YAML file.")] = None,
    hyperparams: Annotated[
        Path | None, typer.Option(help="Hyper-parameters to use instead of the default ones, a YAML file.")
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            help="Suite that scores a policy. Default: that of the environment; in the duel the ally's."
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Number of rounds per rival.")] = 100,
    storage: StorageOption = None,
    study_name: StudyNameOption = None,
    *,
    game: Annotated[Given, game_options()],
    workers: WorkersOption = Workers(1),
    allow: AllowOption = None,
) -> None:
    """Search hyper-parameters; run it again to resume, or on further machines to share the work.

    Example: fpg-bench tune run ppo FPG/AllyVsScripted-v0 --out runs/tune/ppo
    """
    require_extra("tune", "optuna")
    from fpg_bench.game.spec import GameSpec
    from fpg_bench.products.tuning.tune import tune

    tune(
        algorithm,
        GameSpec.of(env_id, **game),
        out,
        n_trials=n_trials,
        workers=workers,
        timeout=timeout,
        study_name=study_name,
        storage=storage,
        n_seeds=n_seeds,
        steps=steps,
        space=space,
        hyperparams=hyperparams,
        suite=suite,
        rounds=rounds,
        allow=allow or (),
    )


@app.command()
@with_fields
def export(
    out: Folder,
    file: Annotated[Path, typer.Argument(help="The hyper-parameter file to write.")],
    n_best: Annotated[int, typer.Option(min=1, help="Number of trials to retrain.")] = 3,
    n_seeds: Annotated[int, typer.Option(min=1, help="Number of fresh training seeds of each.")] = 3,
    steps: Annotated[
        int | None, steps_option("Training budget of a seed. Default: that of the study.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write the values even if they score less than the present ones.")
    ] = False,
    storage: StorageOption = None,
    study_name: StudyNameOption = None,
    workers: WorkersOption = Workers(1),
    allow: AllowOption = None,
) -> None:
    """Retrain a study's best trials on fresh seeds, and write the best values into a file.

    Example: fpg-bench tune export runs/tune/ppo my_ppo.yml
    """
    require_extra("tune", "optuna")
    from fpg_bench.products.tuning.export import export_values

    with locked(out / "export", out):
        export_values(
            out,
            file,
            n_best=n_best,
            n_seeds=n_seeds,
            steps=steps,
            force=force,
            storage=storage,
            study_name=study_name,
            workers=workers,
            allow=allow or (),
        )
