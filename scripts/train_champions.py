"""Train the champions of baselines/champions.yml and ship them to baselines/agents.

python scripts/train_champions.py                                 all of them; run it again to resume
python scripts/train_champions.py --only ally-champion --seed 0   one

Of a double oracle, the iterations of all seeds stand beside the agents.
"""

from __future__ import annotations

from pathlib import Path

from command import run

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.league.double_oracle import ROWS, keep_search

CHAMPIONS = baselines_folder() / "champions.yml"


def main(
    only: str | None = None,
    seed: int | None = None,
    file: Path = CHAMPIONS,
    runs: Path = Path("runs/champions"),
) -> None:
    """Train and ship what is missing, of one champion or training seed if they are named."""
    champions = load_champions(file)
    if only is not None and only not in champions:
        raise UserError(f"only: no champion {only!r}{nearest(only, champions)}")
    if only is not None and isinstance(revision := champions[only], str):
        raise UserError(f"only: {only} is trained at revision {revision}; check it out and run this")
    for name, champion in champions.items():
        if isinstance(champion, str) or only not in (None, name):
            continue
        folder = baselines_folder() / "agents" / name / champion.config.algorithm
        for each in range(champion.seeds) if seed is None else (seed,):
            work = runs / name / f"seed_{each}"
            agent = champion.train(each, work, progress=False)
            command = f"python scripts/train_champions.py --only {name} --seed {each}"
            champion.ship(agent, folder / f"seed_{each}", each, command)
            if (work / ROWS).exists():
                keep_search(work, folder / ROWS)
            print(f"shipped: {folder / f'seed_{each}'}", flush=True)


if __name__ == "__main__":
    run(main)
