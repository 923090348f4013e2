"""``fpg-bench reproduce``: published figures and claims."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import LANGUAGE_MODEL, TRAINING, WorkersOption
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import require_extra
from fpg_bench.common.output import print_line
from fpg_bench.common.parallel import Workers

YANG = "yang-2026"
PAPERS = {  # each but the first in a module of its name
    YANG: "MADDPG for both sides of the frequency point game, fig3 to fig7",
    "ali-2023": "five variants of DQN against jammers that do not listen",
    "firouzbakht-2013": "rates against jamming powers: closed form and self-play",
    "liu-2018": "DQN on the spectrum waterfall against four jammers",
}
_YANG = f"Of {YANG} alone"


def reproduce(
    name: Annotated[str | None, typer.Argument(help="Name of the paper; omit it to list them.")] = None,
    target: Annotated[
        str, typer.Argument(help=f"Of {YANG} alone: fig3, fig4, fig5, fig6, fig7 or all.")
    ] = "all",
    out: Annotated[Path, typer.Option(help="Folder of rows, figures and reports.")] = Path("reproduced"),
    scenario: Annotated[
        str, typer.Option(help="paper, standard or figures.", rich_help_panel=_YANG)
    ] = "paper",
    budget: Annotated[
        str,
        typer.Option(
            help=f"quick, a try, or full, up to an hour; {YANG} (hours) also has hundredth, tenth and paper.",
            rich_help_panel=TRAINING,
        ),
    ] = "quick",
    n_seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of training seeds of each condition. Default: that of the budget.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    first_seed: Annotated[
        int,
        typer.Option(
            min=0, help="First training seed; fresh seeds confirm a finding.", rich_help_panel=TRAINING
        ),
    ] = 0,
    learner: Annotated[
        str, typer.Option(help="torch, or jax, which is faster (extra fast).", rich_help_panel=_YANG)
    ] = "torch",
    workers: WorkersOption = Workers(2),
    llm: Annotated[
        bool,
        typer.Option(
            "--llm",
            help=f"Also run the language model that the environment variables name, of {YANG} alone.",
            rich_help_panel=LANGUAGE_MODEL,
        ),
    ] = False,
    transcript: Annotated[
        Path | None,
        typer.Option(
            help=f"Replay this transcript of a language model, without a server, of {YANG} alone.",
            rich_help_panel=LANGUAGE_MODEL,
        ),
    ] = None,
) -> None:
    """Run a paper's experiments, draw its figures and report its claims; run it again to resume.

    Example: fpg-bench reproduce ali-2023 --budget quick --out reproduced
    """
    if name is None:
        for known, about in PAPERS.items():
            print_line(f"{known:<16} {about}")
        return
    if name not in PAPERS:
        raise UserError(f"unknown paper {name!r}{nearest(name, PAPERS)}")
    require_extra("train", "torch", "stable_baselines3", "matplotlib", "jinja2")
    from fpg_bench.products.papers.reproduce import GameStudy
    from fpg_bench.products.papers.reproduce import reproduce as run_study

    if name == YANG:
        from fpg_bench.products.papers.yang_2026.study import DuelStudy

        study: GameStudy | DuelStudy = DuelStudy(target, scenario, learner, llm, transcript)
    else:
        given = {
            f"target {target!r}": target != "all",
            "--scenario": scenario != "paper",
            "--learner": learner != "torch",
            "--llm": llm,
            "--transcript": transcript is not None,
        }
        if lacking := next((option for option, is_given in given.items() if is_given), None):
            raise UserError(f"{name} has no {lacking}; omit it, or name {YANG}")
        study = GameStudy(import_module(f"fpg_bench.products.papers.{name.replace('-', '_')}").PAPER)
    written = run_study(study, out, budget=budget, n_seeds=n_seeds, first_seed=first_seed, workers=workers)
    for path in written:
        print_line(f"written: {path}")
