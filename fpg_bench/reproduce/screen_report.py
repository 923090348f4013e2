"""What the scripted screen says: rows, the specification curve, and a page of what hangs on each point."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.files import write_whole
from fpg_bench.reproduce.claims import CLAIMS
from fpg_bench.reproduce.curve import Spot, claims_of, draw_curve, shares, spots
from fpg_bench.reproduce.figures import save_figure
from fpg_bench.reproduce.readings import POINTS, every_reading
from fpg_bench.reproduce.report import markdown_table
from fpg_bench.reproduce.screen import screen_all
from fpg_bench.rows import Row

GAMES = {"quick": 12}  # matches of each pair; every other budget: 96
_GAMES = 96
_HEAD = """\
# The paper's claims under every reading: scripted players

{count} readings of the paper were played, every combination of the settings below. Nobody learns here:
scripts stand for both sides (`fpg_bench/reproduce/screen.py` says which). So this page says what the *game*
rewards under a reading, and where a training is worth its hours. A claim holds under a reading where all its
parts do, each with p below 0.05 (two-sided, Welch; parts of one claim need no correction: all have to hold).

![Each claim under each reading: blue holds, orange has a part that is the opposite](figures/screen.png)

"""


def reproduce_screen(out: Path, budget: str, points: Iterable[str] = POINTS, **where: Any) -> list[Path]:
    """Screen readings, and write ``screen.jsonl``, ``screen.md`` and the specification curve.

    Args:
        out: the folder; rows that are there are not made again.
        budget: ``quick`` plays few matches.
        points: which points differ.
        **where: ``workers``, ``backend``, ``address`` and ``say``; see :func:`fpg_bench.jobs.run.run_jobs`.

    Returns:
        The files written.

    Raises:
        UserError: an unknown point, rows that are none, or readings that failed (the others are kept).
    """
    rows = screen_all(every_reading(points), out / "screen.jsonl", GAMES.get(budget, _GAMES), **where)
    written = save_figure(draw_curve(rows), out / "figures" / "screen")
    write_whole(out / "screen.md", _HEAD.format(count=len(rows)) + _tables(rows))
    return [*written, out / "screen.md"]


def _tables(rows: Sequence[Row]) -> str:
    found = {claim: spots(rows, claim) for claim in claims_of(rows)}
    parts = {
        "How often each claim holds": _held(found),
        "What hangs on each point": _by_setting(found),
        "Readings under which most claims hold": _best(found),
    }
    return "\n\n".join(f"## {title}\n\n{table}" for title, table in parts.items()) + "\n"


def _held(found: dict[str, list[Spot]]) -> str:
    lines = [["claim", "the paper", "holds", "a part is the opposite", "weakest part most often"]]
    for claim, each in found.items():
        held, against = sum(spot.holds for spot in each), sum(spot.against > 0 for spot in each)
        statements = [spot.statement for spot in each if not spot.holds]
        weakest = max(set(statements), key=lambda said: (statements.count(said), said)) if statements else "-"
        lines.append([claim, CLAIMS[claim], f"{held} of {len(each)}", str(against), weakest])
    return markdown_table(lines)


def _by_setting(found: dict[str, list[Spot]]) -> str:
    by_claim = {claim: shares(each) for claim, each in found.items()}
    lines = [["point", "setting", "what it says", *(f"{claim} holds %" for claim in found)]]
    for point, known in POINTS.items():
        for name, setting in known.items():
            held = [by_claim[claim].get((point, name)) for claim in found]
            if None not in held:
                cells = [f"{100 * share:.0f}" for share in held if share is not None]
                lines.append([point, f"`{name}`", setting.about, *cells])
    return markdown_table(lines)


def _best(found: dict[str, list[Spot]], most: int = 10) -> str:
    held: dict[str, list[str]] = {}
    for claim, each in found.items():
        for spot in each:
            held.setdefault(spot.reading.name, []).extend([claim] if spot.holds else [])
    order = sorted(held, key=lambda name: (-len(held[name]), name.count("="), name))
    lines = [["reading", "claims that hold"]]
    return markdown_table(lines + [[f"`{name}`", ", ".join(held[name]) or "none"] for name in order[:most]])
