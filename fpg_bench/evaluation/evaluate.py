"""An evaluation: players against a panel into a results folder, and the table made of it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, load_panel
from fpg_bench.evaluation.runner import Contestant, contestant, play_panel
from fpg_bench.evaluation.summary import Summary, check_references, summarise
from fpg_bench.files import read_json, write_json
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile

ALL_SCRIPTED = "all-scripted"


def evaluate(
    players: Sequence[str],
    panel_name: str,
    out: str | Path,
    *,
    rounds: int | None = None,
    name: str | None = None,
    progress: Callable[[Contestant, Entry], None] = lambda who, entry: None,
) -> list[Summary]:
    """Play players against a panel; rounds that are in the folder already are not played again.

    Args:
        players: names by the one grammar of players, or ``all-scripted``; agents of one algorithm with
            several training seeds become one line of the table.
        panel_name: a panel's name or YAML file.
        out: the results folder; ``rows.jsonl`` grows as rounds end.
        rounds: rounds per entry and training seed; None: the panel's own.
        name: what rows and tables call the players given; None: their own names. Not a script's name.
        progress: called before each entry.

    Returns:
        The summaries of all players in the folder, best first.

    Raises:
        UserError: something unknown, of the wrong side, or a folder that holds another panel's rows.
    """
    out = Path(out)
    panel = _with_rounds(load_panel(panel_name), rounds)
    check_references(panel)
    specs = [s for player in players for s in (SCRIPTED[panel.side] if player == ALL_SCRIPTED else [player])]
    contestants = [contestant(spec, panel.side, panel, name) for spec in specs]
    _claim(out, panel, panel_name)
    file = RowFile(out / "rows.jsonl")
    with file.locked():
        for who in contestants:
            play_panel(who, panel, file, functools.partial(progress, who))
    return summarise(file.read(), panel)


def read_results(folder: str | Path) -> tuple[list[Summary], Panel]:
    """The summaries of a results folder, and its panel.

    Raises:
        UserError: no results folder, or one of a panel that is not this version's.
    """
    folder = Path(folder)
    about = read_json(folder / "evaluation.json", "results")
    panel = _with_rounds(load_panel(about["panel"]), about["rounds"])
    if panel.hash != about["panel_hash"]:
        raise UserError(f"results {folder}: played under another version of {about['panel']}; evaluate again")
    return summarise(RowFile(folder / "rows.jsonl").read(), panel), panel


def _with_rounds(panel: Panel, rounds: int | None) -> Panel:
    if rounds is not None and rounds < 1:
        raise UserError(f"rounds: expected a whole number above 0, got {rounds}")
    return panel if rounds is None else dataclasses.replace(panel, rounds=rounds)


def _claim(out: Path, panel: Panel, panel_name: str) -> None:
    """Say in the folder which panel its rows are of; refuse a folder of another."""
    path = out / "evaluation.json"
    rows = out / "rows.jsonl"
    if path.exists() and rows.exists() and rows.stat().st_size:
        found = read_json(path, "results")
        if found.get("panel_hash") != panel.hash:
            raise UserError(
                f"results {out}: hold rows of {found.get('panel')} with {found.get('rounds')} rounds, or of "
                f"another version of it, not of {panel.name} with {panel.rounds}; choose another folder"
            )
        return
    write_json(path, {"panel": panel_name, "panel_hash": panel.hash, "rounds": panel.rounds})
