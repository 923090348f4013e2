"""Measure what normalises each panel entry: the round returns of the random and the reference player.

    python scripts/measure_panels.py [PANEL ...] [--rounds 500]

Writes PANEL.scores.json beside each panel. Fails where a reference is not ten standard errors above
random: such an entry tells players apart by chance and does not belong in a panel.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys

import numpy as np

from fpg_bench import __version__
from fpg_bench.evaluation.panel import (
    PANEL_FOLDER,
    STANDARD_ERRORS,
    Entry,
    Panel,
    Reference,
    load_panel,
    scores_file,
)
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.files import write_whole


def returns(spec: str, panel: Panel, entry: Entry, rounds: int) -> tuple[float, ...]:
    """The panel side's round returns of a scripted player, in the order of the chance seeds."""
    rows = [row for batch in play_entry(spec, panel, entry, rounds) for row in batch]
    rows.sort(key=lambda row: (row["seed"], row["round"]))
    return tuple(round(row[f"{panel.side}_return"], 3) for row in rows)


def measure(panel: Panel, rounds: int) -> bool:
    """Write a panel's reference scores; whether every entry tells the two players apart."""
    entries, fine = {}, True
    for entry in panel.entries:
        found = Reference(*(returns(spec, panel, entry, rounds) for spec in ("random", panel.reference)))
        fine &= found.standard_errors >= STANDARD_ERRORS
        print(
            f"{panel.name:20} {entry.name:22} random {np.mean(found.random):9.2f}  {panel.reference} "
            f"{np.mean(found.reference):9.2f}  {found.standard_errors:6.1f} standard errors apart"
        )
        entries[entry.name] = dataclasses.asdict(found)
    content = {"panel_hash": panel.hash, "version": __version__, "entries": entries}
    write_whole(scores_file(PANEL_FOLDER / f"{panel.name}.yml"), json.dumps(content))
    return fine


def main() -> int:
    """Measure the named panels, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("panels", nargs="*", default=sorted(path.stem for path in PANEL_FOLDER.glob("*.yml")))
    parser.add_argument("--rounds", type=int, default=500)
    options = parser.parse_args()
    fine = [measure(load_panel(name, references=False), options.rounds) for name in options.panels]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
