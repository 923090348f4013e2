"""Measure what normalises each panel entry: the mean round returns of the random and the reference player.

    python scripts/measure_panels.py [PANEL ...] [--rounds 2000]

Writes PANEL.scores.json beside each panel. Fails where a reference is not ten standard errors above
random: such an entry tells players apart by chance and does not belong in a panel.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from fpg_bench import __version__
from fpg_bench.evaluation.panel import PANEL_FOLDER, STANDARD_ERRORS, Entry, Panel, load_panel, scores_file
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.files import write_json


def returns(spec: str, panel: Panel, entry: Entry, rounds: int) -> np.ndarray:
    """The panel side's round returns of a scripted player, in the order of the chance seeds."""
    rows = [row for batch in play_entry(spec, panel, entry, rounds) for row in batch]
    rows.sort(key=lambda row: (row["seed"], row["round"]))
    return np.array([row[f"{panel.side}_return"] for row in rows])


def measure(panel: Panel, rounds: int) -> bool:
    """Write a panel's reference scores; whether every entry tells the two players apart."""
    entries, fine = {}, True
    for entry in panel.entries:
        random, reference = (returns(spec, panel, entry, rounds) for spec in ("random", panel.reference))
        difference = reference - random
        error = float(difference.std(ddof=1) / np.sqrt(len(difference)))
        fine &= difference.mean() >= STANDARD_ERRORS * error
        print(
            f"{panel.name:20} {entry.name:24} random {random.mean():10.2f}  "
            f"{panel.reference} {reference.mean():10.2f}  "
            f"{difference.mean() / error:6.1f} standard errors apart"
        )
        entries[entry.name] = {
            "random": float(random.mean()),
            "reference": float(reference.mean()),
            "standard_error": error,
        }
    content = {"panel_hash": panel.hash, "rounds": rounds, "version": __version__, "entries": entries}
    write_json(scores_file(PANEL_FOLDER / f"{panel.name}.yml"), content)
    return bool(fine)


def main() -> int:
    """Measure the named panels, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("panels", nargs="*", default=sorted(path.stem for path in PANEL_FOLDER.glob("*.yml")))
    parser.add_argument("--rounds", type=int, default=2000)
    options = parser.parse_args()
    fine = [measure(load_panel(name), options.rounds) for name in options.panels]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
