"""What a field must be: how alike two closings rank the trained entries, by size and by choice.

Two closings over the same entries with different seeds; the second one is for this comparison only:

    fpg-bench season close training-1 --work runs/training-1
    fpg-bench season close twin-1 --work runs/twin-1 --out runs/twin-1/field
    python scripts/measure_fields.py runs/training-1 runs/twin-1 --known runs/known

``--known`` names a folder for what entries earn against the scripts and trained entries of the other side; it
is played once. The board's ``worst`` is the lowest over these and the field together.

Spearman's rank correlation is over the trained entries (the mean over an entry's training seeds). A script
is no entry here: it would raise the correlation, since scripts are far apart. ``random`` is the median of
400 random parts of both closings, and its lowest tenth; ``representative`` is how a season chooses,
``diverse`` how a population to train on does.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from fpg_bench.seasons.choosing import diverse, representative
from fpg_bench.seasons.close import OTHER, PROFILE, played
from fpg_bench.seasons.entries import apart, of_side, read_entries

Choose = Callable[[np.ndarray, int], list[int]]
PLURAL = {"ally": "allies", "opponent": "opponents"}
SIZES = (2, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40)


def mean(returns: np.ndarray) -> np.ndarray:
    """``(entries,)``: what entries earn a step against a field ``(entries, counterparts)`` on average."""
    return returns.mean(axis=1)


def worst(returns: np.ndarray, lowest: int = 1) -> np.ndarray:
    """``(entries,)``: the mean of the so many lowest returns of each entry."""
    return np.sort(returns, axis=1)[:, :lowest].mean(axis=1)


SCORES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mean": mean,
    "worst": worst,
    "lowest 2": partial(worst, lowest=2),
    "lowest 3": partial(worst, lowest=3),
}


def agreement(a: np.ndarray, b: np.ndarray, score: Callable[[np.ndarray], np.ndarray]) -> float:
    """Spearman's rank correlation of a score of the same entries under two fields."""
    return float(spearmanr(score(a), score(b)).statistic)


def curve(
    a: np.ndarray,
    b: np.ndarray,
    score: Callable[[np.ndarray], np.ndarray],
    sizes: list[int],
    draws: int = 400,
) -> list[np.ndarray]:
    """Per size, ``(draws,)``: the agreement of random parts of two fields, of so many counterparts each."""
    rng = np.random.default_rng(0)
    found = []
    for size in sizes:
        parts = [
            [field[:, rng.choice(field.shape[1], size, replace=False)] for field in (a, b)]
            for _ in range(draws)
        ]
        found.append(np.array([agreement(x, y, score) for x, y in parts]))
    return found


class Closed:
    """What entries earned against all candidates of a side in a closing.

    Attributes:
        candidates: their names.
        returns: ``(players, candidates)`` a step.
        entries: ``(trained entries, candidates)``, the mean over training seeds.
    """

    def __init__(self, work: Path, side: str) -> None:
        files = sorted((work / side).glob(f"*/{PROFILE}"))
        rows = [RowFile(file).read() for file in files]
        whole = max(map(len, rows))
        self.candidates = [f.parent.name for f, found in zip(files, rows, strict=True) if len(found) == whole]
        rows = [found for found in rows if len(found) == whole]
        self.returns = np.array([[row[OTHER[side]] for row in found] for found in rows]).T
        names = [row["entry"] if "/" in row["player"] else None for row in rows[0]]
        self.names = [name for name in dict.fromkeys(names) if name]
        self.entries = np.array(
            [self.returns[[n == name for n in names]].mean(axis=0) for name in self.names]
        )
        self.agents = self.returns[[n is not None for n in names]]

    def field(self, size: int, choose: Choose = representative) -> np.ndarray:
        """``(trained entries, size)``: against the field that is chosen."""
        return self.entries[:, choose(self.returns, size)]


def play_known(side: str, folder: Path, rounds: int = 30) -> None:
    """Let all entries play the entries of a side, one training seed of each, once."""
    entries = read_entries()
    for known in apart(of_side(entries, side)):
        file = RowFile(folder / side / known.name.partition("/")[2] / PROFILE)
        there = {row["player"] for row in file.read()}
        for entry in apart(of_side(entries, OTHER[side])):
            path = known.path if side == "opponent" else entry.path
            for player in entry.players:
                if player not in there:
                    found = played(player, OTHER[side], known.players[0], path, "known", rounds)
                    file.append([{"entry": entry.name, "player": player, **found}])


def tell(
    a: Closed, b: Closed, side: str, known: np.ndarray | None = None, scripts: np.ndarray | None = None
) -> None:
    """Print the agreement of two closings by size.

    Args:
        a, b: the closings.
        side: of their candidates.
        known: ``(trained entries, n)``, returns against what everybody knew, for the board's ``worst``.
        scripts: ``(n,)`` bool, which of them are scripts.
    """
    counts = a.entries.shape[1], b.entries.shape[1]
    sizes = [size for size in SIZES if size <= min(counts)]
    print(f"{PLURAL[side]}: {counts[0]} and {counts[1]} candidates, {len(a.names)} trained entries")
    print(f"| {PLURAL[side]} | {' | '.join(map(str, sizes))} | all |")
    print("| --- " * (len(sizes) + 2) + "|")
    for name, score in SCORES.items():
        every = f"{agreement(a.entries, b.entries, score):.2f}"
        drawn = curve(a.entries, b.entries, score, sizes)
        cells = [f"{np.median(found):.2f} ({np.quantile(found, 0.1):.2f})" for found in drawn]
        print(f"| {name}, random | {' | '.join(cells)} | {every} |")
        for choose in (representative, diverse):
            parts = [(a.field(size, choose), b.field(size, choose)) for size in sizes]
            chosen = [f"{agreement(x, y, score):.2f}" for x, y in parts]
            print(f"| {name}, {choose.__name__} | {' | '.join(chosen)} | {every} |")
    if known is not None and scripts is not None:
        parts = [[np.hstack((known, c.field(size))) for c in (a, b)] for size in sizes]
        chosen = [agreement(x, y, worst) for x, y in parts]
        print(f"| worst, representative and known | {' | '.join(f'{found:.2f}' for found in chosen)} | |")
        for what, part in (("scripts", known[:, scripts]), ("scripts and trained entries", known)):
            for name in ("mean", "worst"):
                found = [agreement(part, c.entries, SCORES[name]) for c in (a, b)]
                print(f"{name}, {what} against each closing: {found[0]:.2f}, {found[1]:.2f}")
    for name in ("mean", "worst"):
        each = agreement(a.agents, b.agents, SCORES[name])
        print(f"{name}, all candidates, over {len(a.agents)} agents: {each:.2f}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("closings", type=Path, nargs=2, help="the working folders of two closings")
    parser.add_argument("--side", choices=tuple(OTHER), action="append", help="of the candidates")
    parser.add_argument("--known", type=Path, help="a folder for what entries earn against the known")
    words = parser.parse_args()
    for side in words.side or OTHER:
        a, b = (Closed(folder, side) for folder in words.closings)
        if words.known:
            play_known(side, words.known)
        if words.known is None:
            tell(a, b, side)
        else:
            known = Closed(words.known, side)
            scripts = [name in SCRIPTED[side] for name in known.candidates]
            tell(a, b, side, known.entries, np.array(scripts))


if __name__ == "__main__":
    main()
