"""Play every scripted ally (and the oracle) against every scripted opponent, and write the table.

python scripts/measure_pairings.py [--rounds 2000] [--path pursuit] [--out docs/pairings.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fpg_bench import make_duel
from fpg_bench.common.files import write_whole
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.measures import measures, pool
from fpg_bench.players.scripted import SCRIPTED

Measures = dict[str, float | None]
TABLES = (
    ("Ally's mean reward per step", "ally_return", 2),
    ("Opponent's mean reward per step", "opponent_return", 2),
    ("Jamming success rate", "jamming_success_rate", 3),
    ("Overlap ratio", "overlap_ratio", 3),
)


def play(ally: str, opponent: str, duel: TwoPlayerBatch, rounds: int) -> Measures:
    """The measures of a pairing over as many rounds as the duel has games; returns per step."""
    play_round(make_match(duel, ally, opponent), seeds=np.array(evaluation_seeds(rounds)))
    found = measures(pool(duel.batch.tallies), duel.batch.histograms.sum(axis=0))
    steps = float(duel.batch.tallies["steps"].sum())
    return found | {f"{side}_return": found[f"{side}_return"] / steps for side in ("ally", "opponent")}  # type: ignore[operator]


def table(title: str, measure: str, digits: int, found: dict[tuple[str, str], Measures]) -> str:
    """One measure of all pairings, allies down, opponents across."""
    allies, opponents = (list(dict.fromkeys(names)) for names in zip(*found, strict=True))
    records: list[Sequence[str]] = [["ally \\ opponent", *opponents], ["---"] * (len(opponents) + 1)]
    records += [[a, *(f"{found[a, o][measure]:.{digits}f}" for o in opponents)] for a in allies]
    return f"## {title}\n\n" + "\n".join("| " + " | ".join(record) + " |" for record in records) + "\n"


def main() -> None:
    """Play all pairings and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=2000)
    parser.add_argument("--path", default="pursuit")
    parser.add_argument("--out", type=Path, default=Path("docs/pairings.md"))
    options = parser.parse_args()
    duel = make_duel(options.rounds, path=options.path)
    found = {
        (ally, opponent): play(ally, opponent, duel, options.rounds)
        for ally in (*SCRIPTED["ally"], "oracle")
        for opponent in (*SCRIPTED["opponent"], "oracle")
    }
    head = (
        "# Scripted players against each other\n\n"
        f"Scenario `standard`, opponent's path `{options.path}`, {options.rounds} rounds a pairing on the\n"
        "first evaluation seeds, the same for all. Oracles see the full state and are upper bounds for what\n"
        "the scripts could know. Made by\n"
        f"`python scripts/measure_pairings.py --rounds {options.rounds} --path {options.path}`.\n"
    )
    write_whole(options.out, "\n".join([head, *(table(*columns, found) for columns in TABLES)]))
    print(options.out.read_text())


if __name__ == "__main__":
    main()
