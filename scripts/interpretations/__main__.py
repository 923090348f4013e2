"""Test the paper's claims under its interpretations; finished rows and runs are kept, so run it again to
continue.

Usage, from the root of the repository:
    python -m scripts.interpretations screen [--games 96] [--out reproduced]
    python -m scripts.interpretations trained --budget hundredth --n-seeds 10 --first-seed 100 [--learner jax]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.paper.experiment import BUDGETS
from fpg_bench.training.maddpg.multi_seed import LEARNERS
from scripts.interpretations.screen import make_screen
from scripts.interpretations.trained import train_variants


def main(arguments: list[str] | None = None) -> None:
    """Run one of the two studies."""
    parser = argparse.ArgumentParser(
        prog="python -m scripts.interpretations", description=__doc__.split("\n")[0]
    )
    studies = parser.add_subparsers(dest="study", required=True)
    screen = studies.add_parser("screen", help="scripted players under all 768 interpretations")
    screen.add_argument("--games", type=int, default=96, help="matches of each pair of scripts")
    trained = studies.add_parser("trained", help="MADDPG under the interpretations that decide")
    trained.add_argument("--budget", choices=BUDGETS, default="quick")
    trained.add_argument("--n-seeds", type=int)
    trained.add_argument("--first-seed", type=int, default=0)
    trained.add_argument("--learner", choices=LEARNERS, default="torch")
    for study in (screen, trained):
        study.add_argument("--out", type=Path, default=Path("reproduced"))
        study.add_argument("--n-jobs", type=int, default=2, help="jobs at once, one thread each")
    options = vars(parser.parse_args(arguments))
    make = make_screen if options.pop("study") == "screen" else train_variants
    try:
        for path in make(**options):
            print(f"written: {path}")
    except UserError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
