"""Train the champions of baselines/champions.yml and ship them to baselines/agents.

python scripts/train_champions.py                                 all of them; run it again to resume
python scripts/train_champions.py --only ally-champion --seed 0   one

Of a double oracle, the iterations of all seeds stand beside the agents.
"""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.output import print_messages
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.league.double_oracle import ROWS, keep_search


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="name of one champion")
    parser.add_argument("--seed", type=int, help="one training seed; default: all of the configuration")
    parser.add_argument("--file", type=Path, help="default: baselines/champions.yml")
    parser.add_argument("--runs", type=Path, default=Path("runs/champions"), help="the runs' folders")
    parser.add_argument("--agents", type=Path, help="folder of the shipped agents; default: baselines/agents")
    parser.add_argument("--progress", action="store_true", help="show the progress of each training")
    options = parser.parse_args()
    print_messages()
    champions = load_champions(options.file or baselines_folder() / "champions.yml")
    if options.only is not None and options.only not in champions:
        raise UserError(f"only: no champion {options.only!r}{nearest(options.only, champions)}")
    if isinstance(revision := champions.get(options.only), str):
        raise UserError(f"only: {options.only} is trained at revision {revision}; check it out and run this")
    agents = options.agents or baselines_folder() / "agents"
    for name, champion in champions.items():
        if isinstance(champion, str) or options.only not in (None, name):
            continue
        for seed in range(champion.seeds) if options.seed is None else (options.seed,):
            run, folder = options.runs / name / f"seed_{seed}", agents / name / champion.config.algorithm
            agent = champion.train(seed, run, progress=options.progress)
            command = f"python scripts/train_champions.py --only {name} --seed {seed}"
            champion.ship(agent, folder / f"seed_{seed}", seed, command)
            if (run / ROWS).exists():
                keep_search(run, folder / ROWS)
            print(f"shipped: {folder / f'seed_{seed}'}", flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background shells ignore it
    try:
        main()
    except UserError as error:
        sys.exit(f"train_champions: {error}")
    except KeyboardInterrupt:
        sys.exit("train_champions: stopped; finished work is kept, run it again to resume")
