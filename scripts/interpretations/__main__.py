"""Screen the paper's claims under all 768 interpretations between scripted players.

Usage, from the root of the repository: ``python -m scripts.interpretations [--games 96] [--out reproduced]``.
Finished rows are kept, so run it again to continue.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.output import print_messages
from scripts.interpretations.screen import make_screen

if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m scripts.interpretations", description=__doc__.split("\n")[0])
    parser.add_argument("--games", type=int, default=96, help="matches of each pair of scripts")
    parser.add_argument("--out", type=Path, default=Path("reproduced"))
    parser.add_argument("--n-jobs", type=int, default=2, help="jobs at once, one thread each")
    print_messages()
    try:
        for path in make_screen(**vars(parser.parse_args())):
            print(f"written: {path}")
    except UserError as error:
        sys.exit(f"error: {error}")
