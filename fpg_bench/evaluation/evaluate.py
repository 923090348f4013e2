"""An evaluation: players against a panel into a results folder, and the table made of it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, load_panel
from fpg_bench.evaluation.runner import Contestant, contestant, play_panel
from fpg_bench.evaluation.shards import play_shards
from fpg_bench.evaluation.summary import Summary, check_references, summarise
from fpg_bench.files import read_json, write_json
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile

ALL_SCRIPTED = "all-scripted"
ROWS, ABOUT = "rows.jsonl", "evaluation.json"  # the files of a results folder


def evaluate(
    players: Sequence[str],
    panel_name: str,
    out: str | Path,
    *,
    rounds: int | None = None,
    name: str | None = None,
    progress: Callable[[Contestant, Entry], None] = lambda who, entry: None,
    jobs: int = 1,
    backend: str = "loky",
    address: str | None = None,
    say: Callable[[str], None] = print,
) -> list[Summary]:
    """Play players against a panel; rounds that are in the folder already are not played again.

    Args:
        players: names by the one grammar of players, or ``all-scripted``; agents of one algorithm with
            several training seeds become one line of the table.
        panel_name: a panel's name or YAML file.
        out: the results folder; ``rows.jsonl`` grows as rounds end.
        rounds: rounds per entry and training seed; None: the panel's own.
        name: what rows and tables call the players given; None: their own names. Not a script's name.
        progress: called before each entry, where they are played one after the other.
        jobs: how many entries are played at once; the rows are the same, their order may differ.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.jobs.run.run_jobs`.
        address: of a Ray cluster.
        say: told a line per entry that begins or ends, where several are played at once.

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
    claim(out, panel_name, panel.hash, rounds=panel.rounds)
    file = RowFile(out / ROWS)
    with file.locked():
        if (jobs, backend, address) == (1, "loky", None):
            for who in contestants:
                play_panel(who, panel, file, functools.partial(progress, who))
        else:
            play_shards(contestants, panel, file, workers=jobs, backend=backend, address=address, say=say)
    return summarise(file.read(), panel)


def read_results(folder: str | Path) -> tuple[list[Summary], Panel]:
    """The summaries of a results folder, and its panel.

    Raises:
        UserError: no results folder, or one of a panel that is not this version's.
    """
    folder = Path(folder)
    about = read_json(folder / ABOUT, "results")
    panel = _with_rounds(load_panel(about["panel"]), about["rounds"])
    if panel.hash != about["panel_hash"]:
        raise UserError(f"results {folder}: played under another version of {about['panel']}; evaluate again")
    return summarise(RowFile(folder / ROWS).read(), panel), panel


def _with_rounds(panel: Panel, rounds: int | None) -> Panel:
    if rounds is not None and rounds < 1:
        raise UserError(f"rounds: expected a whole number above 0, got {rounds}")
    return panel if rounds is None else dataclasses.replace(panel, rounds=rounds)


def claim(out: Path, panel_name: str, panel_hash: str, **size: int) -> None:
    """Say in a folder which panel its rows are of, and how many rounds or matches it has.

    Raises:
        UserError: it holds rows of another panel.
    """
    path = out / ABOUT
    rows = out / ROWS
    about = {"panel": panel_name, "panel_hash": panel_hash, **size}
    if not (path.exists() and rows.exists() and rows.stat().st_size):
        write_json(path, about)
        return
    found = read_json(path, "results")
    if found.get("panel_hash") != panel_hash:
        raise UserError(
            f"results {out}: hold rows of {_sized(found)}, or of another version of it, "
            f"not of {_sized(about)}; choose another folder"
        )


def _sized(about: dict[str, Any]) -> str:
    sizes = [f"{about[key]} {key}" for key in ("rounds", "matches") if key in about]
    return f"{about.get('panel')} with {' and '.join(sizes)}"
