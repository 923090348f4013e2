"""What the scripted screen says: rows, the specification curve, and a page of what hangs on each point."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.common.files import read_bounded, write_whole
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import read_object
from fpg_bench.paper.claims import ASPECTS, LEVEL
from fpg_bench.paper.curve import Spot, claims_of, draw_curve, shares, spots
from fpg_bench.paper.figures import save_figure
from fpg_bench.paper.readings import POINTS, as_reading, every_reading
from fpg_bench.paper.report import markdown_table
from fpg_bench.paper.screen import screen_all

ROWS = "screen.jsonl.gz"
_LARGEST = 2**26  # bytes of all rows; those of 768 readings are two million
GAMES = {"quick": 12}  # matches of each pair; every other budget: 96
_GAMES = 96
_HEAD = """\
# The paper's claims under every reading: scripted players

{count} readings of the paper were played, every combination of the settings below. Nobody learns here:
scripts stand for both sides (`fpg_bench/paper/screen.py` says which). So this page says what the *game*
rewards under a reading, and where a training is worth its hours. A claim holds under a reading where all its
parts do, each with p below 0.05 (two-sided, Welch; parts of one claim need no correction: all have to hold).
Readings are not corrected for how many there are: by chance alone a claim of one part, positive by nothing,
would hold under one in forty.

![Each claim under each reading: blue holds, orange has a part that is the opposite](figures/screen.png)

Blue: the claim holds; orange: one of its parts is the opposite; grey: neither is shown. Above, each dot is a
reading by its weakest part; grey background: the interval of that part holds zero. Below, a stroke marks the
settings of the reading above it.

"""
_OF_BINS = """\
Lowest to highest over the readings. The paper's overlap stays near 54 % (54.46, 54.39, 53.69). An ally on
fifteen points fills half of thirty bins, and a jammer whose centre is continuous fills them all. So finer
bins alone bring the overlap of two even spectra near a half, whoever plays. The paper does not say how wide
its bins are."""


def reproduce_screen(out: Path, budget: str, points: Iterable[str] = POINTS, **where: Any) -> list[Path]:
    """Screen readings, and write their rows, ``screen.md`` and the specification curve.

    Args:
        out: the folder; rows in its ``screen.jsonl`` are not made again. All of them, in the order of
            the readings, are in ``screen.jsonl.gz`` at the end.
        budget: ``quick`` plays few matches.
        points: which points differ.
        **where: ``workers``, ``backend``, ``address`` and ``say``; see :func:`.run_jobs`.

    Returns:
        The files written.

    Raises:
        UserError: an unknown point, rows that are none, or readings that failed (the others are kept).
    """
    rows = screen_all(every_reading(points), out / "screen.jsonl", GAMES.get(budget, _GAMES), **where)
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    write_whole(out / ROWS, gzip.compress(text.encode(), mtime=0))
    return [out / ROWS, *write_screen(rows, out)]


def read_screen(folder: Path) -> list[Row]:
    """The rows of a whole screen, ``screen.jsonl.gz``; raises UserError where they cannot be read."""
    return [read_object(line) for line in read_bounded(folder / ROWS, "rows", _LARGEST).splitlines()]


def write_screen(rows: Sequence[Row], out: Path) -> list[Path]:
    """Write ``screen.md`` and the specification curve of a screen's rows; gives the files."""
    written = save_figure(draw_curve(rows), out / "figures" / "screen")
    write_whole(out / "screen.md", _HEAD.format(count=len(rows)) + _tables(rows))
    return [*written, out / "screen.md"]


def _tables(rows: Sequence[Row]) -> str:
    found = {claim: spots(rows, claim) for claim in claims_of(rows)}
    parts = {
        "How often each claim holds": _held(found),
        "Part by part": _parts(rows),
        "What hangs on each point": by_setting(rows),
        "Readings under which most claims hold": _best(found),
        "How far the spectra overlap (Fig. 4)": _bins(rows) + "\n\n" + _OF_BINS,
        "How it was made": _made(rows),
    }
    return "\n\n".join(f"## {title}\n\n{table}" for title, table in parts.items()) + "\n"


def _made(rows: Sequence[Row]) -> str:
    games = rows[0]["games"]
    budget = next((name for name, count in GAMES.items() if count == games), "full")
    return (
        f"```bash\nfpg-bench reproduce screen --budget {budget} --out reproduced\n```\n\n"
        f"{games} matches of each pair of scripts, on evaluation seeds, one round of each; of planned paths "
        f"{max(2, games // 3)} matches, with all rounds that the planner remembers."
    )


def _held(found: dict[str, list[Spot]]) -> str:
    lines = [["claim", "the paper", "holds", "a part is the opposite", "weakest part most often"]]
    for claim, each in found.items():
        held, against = sum(spot.holds for spot in each), sum(spot.against > 0 for spot in each)
        statements = [spot.weakest["statement"] for spot in each if not spot.holds]
        weakest = max(set(statements), key=lambda said: (statements.count(said), said)) if statements else "-"
        lines.append([claim, ASPECTS[claim], f"{held} of {len(each)}", str(against), weakest])
    return markdown_table(lines)


def _parts(rows: Sequence[Row]) -> str:
    """Every atomic claim: under how many readings it is shown, and its opposite."""
    lines = [["claim", "claimed to be positive", "shown", "the opposite shown", "neither"]]
    for number, part in enumerate(rows[0]["parts"]):
        same = [row["parts"][number] for row in rows]
        shown = [each for each in same if each["p"] < LEVEL]
        above = sum(each["mean"] > 0 for each in shown)
        counts = (above, len(shown) - above, len(same) - len(shown))
        lines.append([part["claim"], part["statement"], *map(str, counts)])
    return markdown_table([lines[0], *sorted(lines[1:])])


def _bins(rows: Sequence[Row]) -> str:
    """The spectrum overlap by 15 points and by 30 bins, early and late, by how the ally hops."""
    lines = [["hops", "stage", "overlap ratio %", "15 points %", "30 bins %"]]
    for hops in POINTS["hops"]:
        some = [row for row in rows if as_reading(row["reading"]).of("hops") == hops]
        for stage, when in enumerate(("early", "late") if some else ()):
            by_bins = [[row["spectrum overlap"][stage][kind] for row in some] for kind in (0, 1)]
            ranges = [[row["overlap"][stage] for row in some], *by_bins]
            said = [f"{100 * min(each):.0f} to {100 * max(each):.0f}" for each in ranges]
            lines.append([hops, when, *said])
    return markdown_table(lines)


def by_setting(rows: Sequence[Row]) -> str:
    """A table: under what share of the readings with each setting each claim holds."""
    by_claim = {claim: shares(spots(rows, claim)) for claim in claims_of(rows)}
    lines = [["point", "setting", "what it says", *(f"{claim} holds %" for claim in by_claim)]]
    for point, known in POINTS.items():
        for name, setting in known.items():
            held = [each.get((point, name)) for each in by_claim.values()]
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
