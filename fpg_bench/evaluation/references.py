"""Measuring what normalises a panel: the round returns of the random and of the reference player."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable

from fpg_bench import __version__
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import (
    STANDARD_ERRORS,
    Entry,
    Panel,
    Reference,
    load_panel,
    panel_file,
    scores_file,
)
from fpg_bench.evaluation.runner import Seeds, play_entry
from fpg_bench.files import write_whole

ROUNDS = 500


def measure_panel(
    name: str, rounds: int = ROUNDS, progress: Callable[[Entry, Reference], None] = lambda entry, found: None
) -> None:
    """Measure a panel's reference scores and write them beside its YAML file.

    Args:
        name: the panel's name or YAML file.
        rounds: how many rounds per entry; the panel can be played with no more than these.
        progress: called with each entry as it is measured.

    Raises:
        UserError: no such panel, or an entry whose reference is not ten standard errors above random: it
            would tell players apart by chance. Nothing is written then.
    """
    panel = load_panel(name, references=False)
    if rounds < max(panel.rounds, 2):
        raise UserError(f"rounds: expected at least the panel's own {panel.rounds}, got {rounds}")
    entries = {}
    for entry in panel.entries:
        found = Reference(
            *(round_returns(spec, panel, entry, rounds) for spec in ("random", panel.reference))
        )
        progress(entry, found)
        if not found.standard_errors >= STANDARD_ERRORS:
            raise UserError(
                f"{panel.name}: {entry.name}: {panel.reference} is {found.standard_errors:.1f} standard "
                f"errors above random, not {STANDARD_ERRORS:.0f}; it does not belong in a panel"
            )
        entries[entry.name] = dataclasses.asdict(found)
    content = {"panel_hash": panel.hash, "version": __version__, "entries": entries}
    write_whole(scores_file(panel_file(name)), json.dumps(content))


def round_returns(
    spec: str, panel: Panel, entry: Entry, rounds: int, seeds: Seeds | None = None
) -> tuple[float, ...]:
    """The panel side's round returns of a player, in the order of the chance seeds."""
    rows = [row for batch in play_entry(spec, panel, entry, rounds, seeds) for row in batch]
    rows.sort(key=lambda row: (row["seed"], row["round"]))
    return tuple(round(row[f"{panel.side}_return"], 3) for row in rows)
