"""The verbs of offline learning: ``offline``, and those that list, make and check data sets."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Given, with_fields
from fpg_bench.cli.options import (
    LocalWorkersOption,
    complete_dataset,
    complete_offline,
    name_all,
    run_options,
    share,
    whole_number,
)
from fpg_bench.cli.training import (
    EvaluationsOption,
    RestartOption,
    ResumeOption,
    RunOption,
    SeedOption,
    SeedsOption,
    train_runs,
)
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_writable
from fpg_bench.common.output import page, print_line, shown_progress
from fpg_bench.common.parallel import Workers
from fpg_bench.training.algorithms import OFFLINE
from fpg_bench.training.config import RunConfig

app = typer.Typer(help="Make and check data sets for offline reinforcement learning.")


@app.command("list")
def list_datasets() -> None:
    """List the available data sets with their players.

    Example: fpg-bench dataset list
    """
    from fpg_bench.products.offline.spec import load_spec, spec_names

    for spec in map(load_spec, spec_names()):
        typer.echo(f"{spec.name}: {spec.description}")
        typer.echo(f"    {spec.env_id}, scenario {spec.scenario}, {spec.steps:,} steps")
        name_all("", spec.players)
    print_line(f"Your own: a YAML file of the same form, see {page('guides/datasets')}")


@app.command()
@with_fields
def make(
    name: Annotated[str, typer.Argument(help="A data set, or a YAML file.", autocompletion=complete_dataset)],
    out: Annotated[
        Path | None, typer.Option(help="Folder of data sets. Default: that of Minari, ~/.minari/datasets.")
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            parser=whole_number,
            metavar="STEPS",
            help="Number of transitions, such as 1e6. Default: that of its specification.",
        ),
    ] = None,
    workers: LocalWorkersOption = Workers(1),
) -> None:
    """Make a data set in Minari's format; run it again to resume.

    Example: fpg-bench dataset make ally-expert-v0 --out datasets --steps 1e6
    """
    require_extra("datasets", "minari", "h5py", "PIL")
    from fpg_bench.products.offline.make import make_dataset
    from fpg_bench.products.offline.spec import load_spec

    spec = load_spec(name, steps)
    with shown_progress() as show:
        folder = make_dataset(spec, out, workers=workers, progress=partial(show, spec.name))
    print_line(f"written: {folder}")


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(help="A data set, or a folder with several.")],
    sample: Annotated[
        str, typer.Option(help="Share of rounds to play again, such as 5%, drawn at random; at least one.")
    ] = "1%",
    sample_seed: Annotated[int, typer.Option(min=0, help="Seed of the draw.")] = 0,
) -> None:
    """Compare a data set with its hash, and check that a sample of its rounds replays to the bit.

    Example: fpg-bench dataset check datasets --sample 1%
    """
    require_extra("datasets", "minari", "h5py", "PIL")
    from fpg_bench.products.offline.check import check_dataset
    from fpg_bench.products.offline.read import find_datasets

    with shown_progress() as show:
        for data in find_datasets(folder):
            line = check_dataset(data, share(sample), sample_seed, progress=partial(show, str(data)))
            print_line(line)


def offline(
    algorithm: Annotated[
        str,
        typer.Argument(
            help=f"{', '.join(OFFLINE)}; bc-stack8 etc. see the last eight observations.",
            autocompletion=complete_offline,
        ),
    ],
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="DATASET",
            help="Folder of a data set, or its name in Minari's folder (see fpg-bench dataset).",
            autocompletion=complete_dataset,
        ),
    ],
    out: RunOption,
    resume: ResumeOption = False,
    restart: RestartOption = False,
    seed: SeedOption = None,
    seeds: SeedsOption = None,
    n_evals: EvaluationsOption = 5,
    *,
    run: Annotated[Given, run_options("steps", "hyperparams", "suite", "allow")],
    workers: LocalWorkersOption = Workers(2),
) -> None:
    """Train an offline algorithm on a data set without interacting with the environment; export the agent.

    Example: fpg-bench offline td3-bc datasets/fpg/ally-mixed-v0 --out runs/td3_bc_0
    """
    check_writable(out)
    require_extra("offline", "minari", "h5py", "PIL", "torch", "stable_baselines3")
    from fpg_bench.products.offline.read import open_dataset

    config = RunConfig.offline(algorithm, open_dataset(dataset), seed=seed or 0, **run)
    train_runs(config, out, seed, seeds, n_evals, resume, restart, workers)
