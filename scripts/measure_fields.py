"""What a field must be: how alike two closings rank the trained entries, by size and by choice.

Two closings over the same entries with different seeds; the second one is for this comparison only:

    fpg-bench season close training-1 --work runs/training-1
    fpg-bench season close twin-1 --work runs/twin-1 --out runs/twin-1/field
    python scripts/measure_fields.py runs/training-1 runs/twin-1

Spearman's rank correlation is over the trained entries (the mean over an entry's training seeds). A script
is no entry here: it would raise the correlation, since scripts are far apart. ``random`` is the median of
400 random parts of both closings, and its lowest tenth; ``chosen`` is what the season's rule chooses.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from fpg_bench.rows import RowFile
from fpg_bench.seasons import agreement
from fpg_bench.seasons.choosing import choose
from fpg_bench.seasons.close import OTHER, PROFILE

SIZES = (2, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40)
SCORES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mean": agreement.mean,
    "worst": agreement.worst,
    "lowest 2": partial(agreement.worst, lowest=2),
    "lowest 3": partial(agreement.worst, lowest=3),
}


class Closed:
    """What entries earned against all candidates of a side in a closing.

    Attributes:
        returns: ``(players, candidates)`` a step.
        entries: ``(trained entries, candidates)``, the mean over training seeds.
    """

    def __init__(self, work: Path, side: str) -> None:
        files = sorted((work / side).glob(f"*/{PROFILE}"))
        rows = [RowFile(file).read() for file in files]
        whole = max(map(len, rows))
        rows = [found for found in rows if len(found) == whole]
        self.returns = np.array([[row[OTHER[side]] for row in found] for found in rows]).T
        names = [row["entry"] if "/" in row["player"] else None for row in rows[0]]
        self.names = [name for name in dict.fromkeys(names) if name]
        self.entries = np.array(
            [self.returns[[n == name for n in names]].mean(axis=0) for name in self.names]
        )
        self.agents = self.returns[[n is not None for n in names]]

    def field(self, size: int) -> np.ndarray:
        """``(trained entries, size)``: against the field that is chosen."""
        return self.entries[:, choose(self.returns, size)]


def tell(a: Closed, b: Closed, side: str) -> None:
    """Print the agreement of two closings by size."""
    counts = a.entries.shape[1], b.entries.shape[1]
    sizes = [size for size in SIZES if size <= min(counts)]
    print(f"{side}s: {counts[0]} and {counts[1]} candidates, {len(a.names)} trained entries")
    print(f"| {side}s | {' | '.join(map(str, sizes))} | all |")
    print("| --- " * (len(sizes) + 2) + "|")
    for name, score in SCORES.items():
        every = f"{agreement.agreement(a.entries, b.entries, score):.2f}"
        drawn = agreement.curve(a.entries, b.entries, score, sizes)
        cells = [f"{np.median(found):.2f} ({np.quantile(found, 0.1):.2f})" for found in drawn]
        print(f"| {name}, random | {' | '.join(cells)} | {every} |")
        chosen = [agreement.agreement(a.field(size), b.field(size), score) for size in sizes]
        print(f"| {name}, chosen | {' | '.join(f'{found:.2f}' for found in chosen)} | {every} |")
    for name in ("mean", "worst"):
        each = agreement.agreement(a.agents, b.agents, SCORES[name])
        print(f"{name}, all candidates, over {len(a.agents)} agents: {each:.2f}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("closings", type=Path, nargs=2, help="the working folders of two closings")
    parser.add_argument("--side", choices=tuple(OTHER), action="append", help="of the candidates")
    words = parser.parse_args()
    for side in words.side or OTHER:
        a, b = (Closed(folder, side) for folder in words.closings)
        tell(a, b, side)


if __name__ == "__main__":
    main()
