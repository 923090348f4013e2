"""What a field must be: how alike two fields rank entries, by their size and how they are chosen.

A closing draws recipes from its seed, trains them and plays the zoo against each; rows go into a file as they
come, and what is there is not done again. Two closings with different seeds are then compared.

    python scripts/measure_fields.py close --side opponent --seed a --count 24 --out runs/fields
    python scripts/measure_fields.py close --side opponent --seed b --count 24 --out runs/fields
    python scripts/measure_fields.py agree --side opponent --seeds a,b --out runs/fields
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from fpg_bench.evaluation.zoo import load_zoo
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from fpg_bench.seasons import agreement
from fpg_bench.seasons.candidates import is_trained, leave_agent, train_candidate
from fpg_bench.seasons.choosing import choose
from fpg_bench.seasons.profiles import played
from fpg_bench.seasons.recipe import Recipe, Target, draw_recipes

VIEWS = {
    "ally": ("ally-scripted", "ally-planner", "duel-ally"),
    "opponent": ("opponent-pursuit", "opponent-learned", "duel-opponent"),
}


def targets(side: str) -> list[Target]:
    """The zoo and the scripts of a side."""
    found: dict[str, list[str]] = {}
    zoo = load_zoo()
    for view in VIEWS[side]:
        for member in zoo.members(view):
            found.setdefault(f"{view}/{member.algorithm}", []).append(member.name)
    flight = {"opponent-pursuit": "pursuit", "duel-opponent": "pursuit", "opponent-learned": "learned"}
    trained = [Target(name, tuple(p), flight.get(name.split("/")[0])) for name, p in found.items()]
    return trained + [Target(name, (name,)) for name in SCRIPTED[side]]


@contextlib.contextmanager
def taken(folder: Path) -> Iterator[bool]:
    """Whether no other process works on this candidate."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder.parent / f".{folder.name}.lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def close(side: str, seed: str, count: int, out: Path) -> None:
    """Train the candidates of a closing that are not there, and play those that were not played."""
    other = "ally" if side == "opponent" else "opponent"
    entries = targets(other)
    folder = out / f"{side}-{seed}"
    for recipe in draw_recipes(f"measure-fields/{seed}", side, count, entries):
        run = folder / recipe.name
        with taken(run) as mine:
            if mine:
                _candidate(recipe, run, entries, RowFile(folder / f"{recipe.name}.jsonl"))


def _candidate(recipe: Recipe, run: Path, entries: list[Target], file: RowFile) -> None:
    if not is_trained(run):
        train_candidate(recipe, run)
        leave_agent(run)
    done = {row["player"] for row in file.read()}
    for entry in entries:
        for player in entry.players:
            if player not in done:
                other = "ally" if recipe.side == "opponent" else "opponent"
                # An ally is met by each opponent as that one flies.
                path = recipe.path if recipe.side == "opponent" else entry.flight or "pursuit"
                found = played(player, other, str(run / "agent"), path, "measure-fields")
                file.append([{"entry": entry.name, "player": player, "candidate": recipe.name, **found}])
    print(recipe, flush=True)


SCORES = {
    "mean": agreement.mean,
    "worst": agreement.worst,
    "lowest 2": partial(agreement.worst, lowest=2),
    "lowest 3": partial(agreement.worst, lowest=3),
}


def returns(side: str, seed: str, out: Path, trained: bool = True) -> tuple[list[str], np.ndarray, list[str]]:
    """Entries' names, one for each training seed, their returns a step ``(players, candidates)``, candidates."""
    other = "ally" if side == "opponent" else "opponent"
    files = sorted((out / f"{side}-{seed}").glob("*.jsonl"))
    whole = sum(len(target.players) for target in targets(other))
    found = [{row["player"]: row for row in RowFile(file).read()} for file in files]
    found = [rows for rows in found if len(rows) == whole]
    wanted = [row for row in found[0].values() if "/" in row["player"] or not trained]
    values = np.array([[rows[row["player"]][other] for rows in found] for row in wanted])
    return (
        [row["entry"] for row in wanted],
        values,
        [rows[wanted[0]["player"]]["candidate"] for rows in found],
    )


def by_entry(names: list[str], values: np.ndarray) -> np.ndarray:
    """``(entries, candidates)``: the mean over the training seeds of each entry."""
    return np.array([values[[n == name for n in names]].mean(axis=0) for name in dict.fromkeys(names)])


def agree(side: str, seeds: list[str], out: Path) -> None:
    """Print how alike two closings rank the trained entries."""
    (names, a, _), (_, b, _) = (returns(side, seed, out) for seed in seeds)
    every = [returns(side, seed, out, trained=False)[1] for seed in seeds]
    most = min(a.shape[1], b.shape[1])
    print(
        f"{side}s: closings of {a.shape[1]} and {b.shape[1]}; {len(names)} agents of {len(set(names))} entries"
    )
    sizes = [n for n in (2, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40) if n <= most]
    for what, (x, y) in {"agents": (a, b), "entries": (by_entry(names, a), by_entry(names, b))}.items():
        for name, score in SCORES.items():
            drawn = agreement.curve(x, y, score, sizes)
            shown = " ".join(
                f"{n}:{np.median(d):.2f}[{np.quantile(d, 0.1):.2f}]"
                for n, d in zip(sizes, drawn, strict=True)
            )
            print(f"{what:8}{name:9} random {shown}")
            chosen = []
            for size in sizes:
                parts = [v[:, choose(e, size)] for v, e in zip((x, y), every, strict=True)]
                chosen.append(f"{size}:{agreement.agreement(*parts, score):.2f}")
            print(f"{what:8}{name:9} greedy {' '.join(chosen)}; all {agreement.agreement(x, y, score):.3f}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("close", "agree"))
    parser.add_argument("--side", choices=("ally", "opponent"), default="opponent")
    parser.add_argument("--seed", default="a", help="of a closing")
    parser.add_argument("--seeds", default="a,b", help="of the closings to compare")
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--out", type=Path, default=Path("runs/fields"))
    words = parser.parse_args()
    if words.what == "agree":
        agree(words.side, words.seeds.split(","), words.out)
    else:
        close(words.side, words.seed, words.count, words.out)


if __name__ == "__main__":
    main()
