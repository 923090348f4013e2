"""How the zoo's agents and the scripts score: one line per training seed and panel entry, committed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice
from typing import Any

import numpy as np

from fpg_bench.evaluation.panel import Entry, Panel, load_panel
from fpg_bench.evaluation.planner_panel import PlannerPanel
from fpg_bench.evaluation.runner import TALLIES, play_entry
from fpg_bench.evaluation.statistics import iqm, iqm_interval
from fpg_bench.evaluation.summary import Summary, pooled_measures
from fpg_bench.evaluation.zoo import Member, Zoo, ZooView
from fpg_bench.game.measures import measures
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import Row, RowFile

LINES = "summary.jsonl"
FIRST_ROUNDS = 2
_DIGITS = 6


def score_lines(spec: Any, panel: Panel, head: Row) -> list[Row]:
    """Play a player against all entries of a panel and sum each of them up in one line.

    Args:
        spec: a player, by its name, folder or itself.
        panel: what it plays.
        head: what each line begins with: ``algorithm``, ``training_seed`` and ``policy_sha256``.

    Returns:
        Per entry: ``n`` rounds, their ``returns`` in the order of seed and round, the ``mean`` of each
        measure (of the pooled rounds), its ``sd`` over rounds, and the ``rows_sha256`` of the rows.
    """
    head = {"panel": panel.name, "panel_hash": panel.hash[:16], **head}
    return [
        head | {"entry": entry.name} | sum_up(_entry_rows(spec, panel, entry, panel.rounds), panel)
        for entry in panel.entries
    ]


def sum_up(rows: Iterable[Row], panel: Panel | PlannerPanel) -> Row:
    """What a line says of the rounds of an entry, as :func:`score_lines` gives it.

    Args:
        rows: of all rounds of one player, in any order.
        panel: tells whose returns count.
    """
    rows = _ordered(rows)
    each = [_round_measures(row) for row in rows]
    return {
        "n": len(rows),
        "returns": _returns(rows, panel),
        "mean": {name: _rounded(value) for name, value in pooled_measures(rows).items()},
        "sd": {name: _rounded(_sd([found[name] for found in each])) for name in each[0]},
        "rows_sha256": hashlib.sha256("".join(json.dumps(row) + "\n" for row in rows).encode()).hexdigest(),
    }


def first_returns(spec: Any, panel: Panel, entry: Entry, rounds: int = FIRST_ROUNDS) -> list[float]:
    """The returns of an entry's first rounds, to be compared with the first of its line."""
    return _returns(_ordered(islice(_entry_rows(spec, panel, entry, rounds), rounds)), panel)


def score_member(member: Member) -> list[Row]:
    """The lines of a shipped agent on its view's panel; raises UserError where it cannot be loaded."""
    about = member.about()
    head = {"algorithm": member.algorithm, "training_seed": member.seed}
    head["policy_sha256"] = about["policy_sha256"]
    return score_lines(str(member.folder), load_panel(member.view.panel), head)


def score_scripts(panel: Panel) -> list[Row]:
    """The lines of all scripted players of a panel's side."""
    heads = [
        {"algorithm": name, "training_seed": None, "policy_sha256": None} for name in SCRIPTED[panel.side]
    ]
    return [line for head in heads for line in score_lines(head["algorithm"], panel, head)]


def score_file(zoo: Zoo, view: ZooView) -> RowFile:
    """The file of a view's lines, only ever appended to."""
    return RowFile(zoo.scores(view) / LINES)


def read_lines(zoo: Zoo, view: ZooView, panel: Panel) -> list[Row]:
    """The lines of a view that speak of this panel and of the agents as they are shipped, newest each."""
    shipped = {(m.algorithm, m.seed): m.about()["policy_sha256"] for m in zoo.members(view.name) if m.shipped}
    found = {}
    for line in score_file(zoo, view).read():
        who = (line["algorithm"], line["training_seed"])
        if line["panel_hash"] == panel.hash[:16] and line["policy_sha256"] == shipped.get(who):
            found[*who, line["entry"]] = line
    return list(found.values())


def add_missing_lines(
    zoo: Zoo, view: ZooView, progress: Callable[[str], None] = lambda name: None
) -> list[Row]:
    """Score a view's scripts and shipped agents where their lines are not there yet.

    Args:
        zoo: the zoo.
        view: one of its views.
        progress: called with the name of whoever is about to be scored.

    Returns:
        All lines of the view.
    """
    panel, file = load_panel(view.panel), score_file(zoo, view)
    with file.locked():
        done = {
            (line["algorithm"], line["training_seed"])
            for line in complete(read_lines(zoo, view, panel), panel)
        }
        if not {(name, None) for name in SCRIPTED[panel.side]} <= done:
            progress(f"{view.name}: scripts")
            file.append(score_scripts(panel))
        for member in zoo.members(view.name):
            if member.shipped and (member.algorithm, member.seed) not in done:
                progress(member.name)
                file.append(score_member(member))
    return read_lines(zoo, view, panel)


def complete(lines: Iterable[Row], panel: Panel) -> list[Row]:
    """The lines of those players of whom a panel's every entry is there."""
    entries: dict[tuple[str, Any], set[str]] = {}
    lines = list(lines)
    for line in lines:
        entries.setdefault((line["algorithm"], line["training_seed"]), set()).add(line["entry"])
    whole = {entry.name for entry in panel.entries}
    return [line for line in lines if entries[line["algorithm"], line["training_seed"]] == whole]


def check_member(zoo: Zoo, member: Member) -> list[str]:
    """Play a shipped agent again, all rounds: what differs from its lines."""
    lines = read_lines(zoo, member.view, load_panel(member.view.panel))
    who = (member.algorithm, member.seed)
    kept = [line for line in lines if (line["algorithm"], line["training_seed"]) == who]
    return differences(score_member(member), kept)


def differences(played: list[Row], kept: list[Row]) -> list[str]:
    """What differs between lines just played and the lines that are kept, entry by entry."""
    before = {line["entry"]: line for line in kept}
    found = []
    for line in played:
        known = before.get(line["entry"])
        if known is None:
            found.append(f"{line['entry']}: no line")
        elif line["returns"] != known["returns"]:
            found.append(f"{line['entry']}: other returns")
        elif line["rows_sha256"] != known["rows_sha256"]:
            found.append(f"{line['entry']}: the same returns, but other rows")
    return found


def score_arrays(lines: Iterable[Row], panel: Panel) -> dict[str, np.ndarray]:
    """Per algorithm or script the normalised scores ``(training seeds, entries, matches)``."""
    assert panel.references is not None
    found: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for line in complete(lines, panel):
        scores = panel.references[line["entry"]].scores(np.array(line["returns"]))
        matches = scores.reshape(-1, panel.scenario.rounds_per_match).mean(axis=1)
        by_seed = found.setdefault(line["algorithm"], {}).setdefault(str(line["training_seed"]), {})
        by_seed[line["entry"]] = matches
    return {
        name: np.array([[seeds[k][entry.name] for entry in panel.entries] for k in sorted(seeds)])
        for name, seeds in found.items()
    }


def seed_scores(lines: Iterable[Row], panel: Panel) -> dict[tuple[str, int], float]:
    """The IQM over entries of each training seed, by algorithm and seed."""
    trained = [line for line in complete(lines, panel) if line["training_seed"] is not None]
    found: dict[tuple[str, int], float] = {}
    for who in {(line["algorithm"], line["training_seed"]) for line in trained}:
        mine = [line for line in trained if (line["algorithm"], line["training_seed"]) == who]
        (scores,) = score_arrays(mine, panel).values()
        found[who] = float(iqm(scores.mean(axis=(0, 2))))
    return found


def summarise_lines(lines: list[Row], panel: Panel) -> list[Summary]:
    """One summary per algorithm and script, best first; measures are means over entries and seeds."""
    found = []
    for name, scores in score_arrays(lines, panel).items():
        mine = [line for line in lines if line["algorithm"] == name]
        trained = mine[0]["training_seed"] is not None
        per_entry = scores.mean(axis=(0, 2))
        found.append(
            Summary(
                player=name,
                training_seeds=len(scores) if trained else 0,
                score=iqm_interval(scores, trained),
                mean=float(per_entry.mean()),
                entries={entry.name: float(x) for entry, x in zip(panel.entries, per_entry, strict=True)},
                measures={key: _mean([line["mean"][key] for line in mine]) for key in mine[0]["mean"]},
                rounds=sum(line["n"] for line in mine),
            )
        )
    return sorted(found, key=lambda s: -s.score.value)


def _entry_rows(spec: Any, panel: Panel, entry: Entry, rounds: int) -> Iterator[Row]:
    return chain.from_iterable(play_entry(spec, panel, entry, rounds))


def _ordered(rows: Iterable[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: (row["seed"], row["round"]))


def _returns(rows: list[Row], panel: Panel | PlannerPanel) -> list[float]:
    return [round(row[f"{panel.side}_return"], 3) for row in rows]


def _round_measures(row: Row) -> dict[str, float | None]:
    histogram = np.array([row["ally_points"], row["jam_points"]])
    return measures({name: row[name] for name in TALLIES}, histogram)


def _mean(values: list[float | None]) -> float | None:
    """The mean of the values that exist."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None


def _sd(values: list[float | None]) -> float | None:
    """The standard deviation over the rounds in which a measure exists."""
    there = [value for value in values if value is not None]
    return float(np.std(there, ddof=1)) if len(there) > 1 else None


def _rounded(value: float | None) -> float | None:
    """To six digits that count, which is far below what chance does to it."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{_DIGITS}g}")
