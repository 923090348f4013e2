"""What the tables show, taken from a board: plain words and numbers, ready for the templates.

A board is data from outside (see :func:`fpg_bench.leaderboard.board.make_board`): a number may be missing,
a text may hold anything. Templates escape all text; what becomes part of a file's name is checked here.
"""

from __future__ import annotations

from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.wording import finite, written

Row = dict[str, Any]
KINDS = {"script": "script", "zoo": "zoo", "submitted": "submitted"}
FEW_SEEDS = "fewer than three training seeds: its interval says little"
_COLUMNS_MOST = 6


def check_board(board: Row) -> None:
    """Raise UserError where a track or an entry has a name that can't be part of a file's."""
    for track in board["tracks"]:
        key = wording.safe_slug(track["key"], "track")
        for row in track["rows"]:
            wording.safe_slug(row["slug"], f"entry of {key}")


def is_verified(row: Row) -> bool:
    """Whether an entry is ranked."""
    return row.get("status") == "verified"


def ordered(rows: list[Row]) -> list[Row]:
    """Entries by rank, then score; those that are not verified last."""

    def place(row: Row) -> tuple[bool, float, float, str]:
        rank, score = row.get("rank"), finite((row.get("score") or {}).get("value"))
        low = finite(rank[0]) if isinstance(rank, list | tuple) and rank else None
        return not is_verified(row), low or 1e9, -(score or -1e9), row["slug"]

    return sorted(rows, key=place)


def page_of(track: Row, row: Row) -> str:
    """The address of an entry's page, from the site's root."""
    return f"entries/{track['key']}/{row['slug']}.html"


def track_view(track: Row) -> Row:
    """What the front page shows of a track."""
    rows = ordered(track["rows"])
    domain = drawing.domain_of([row.get("score") for row in rows])
    names = _columns(rows)
    best_response = any(value_of(row.get("best_response")) is not None for row in rows)
    return {
        "key": track["key"],
        "title": track["title"],
        "side": track.get("side"),
        "panel": track.get("panel"),
        "rounds": track.get("rounds"),
        "reference": track.get("reference"),
        "entries": list(track.get("entries") or []),
        "columns": [{"name": name, **wording.measure_of(name)._asdict()} for name in names],
        "best_response": best_response,
        "axis": axis_of(domain),
        "rows": [_row_view(track, row, names, domain) for row in rows],
        "strengths": _strengths(track, rows),
        "leaders": _leaders(rows),
    }


def _columns(rows: list[Row]) -> list[str]:
    """Which measures stand in the table: those that matter most, else the first that there are."""
    there = [name for row in rows for name in (row.get("measures") or {})]
    known = [name for name in wording.COLUMNS if name in there]
    return known or list(dict.fromkeys(there))[:_COLUMNS_MOST]


def _in_column(value: Any, style: str) -> str:
    """A number under a heading that says its unit."""
    return written(value, "score" if "/" in style else style)


def axis_of(domain: drawing.Domain) -> Row:
    """Where the marks of 0 and 100 stand."""
    return {"zero": drawing.place(0, domain), "hundred": drawing.place(100, domain)}


def _row_view(track: Row, row: Row, names: list[str], domain: drawing.Domain) -> Row:
    measures = row.get("measures") or {}
    score, worst = row.get("score") or {}, row.get("worst") or {}
    return {
        **entry_head(track, row),
        "score": written(score.get("value")),
        "score_sort": finite(score.get("value")),
        "interval": wording.interval_text(score),
        "over": score.get("over") or "",
        "picture": drawing.interval_picture(score, domain),
        "rank_sort": finite((row.get("rank") or [None])[0]),
        "lead": share_text(_lead(row)),
        "lead_sort": _lead(row),
        "worst": written(worst.get("value")),
        "worst_sort": finite(worst.get("value")),
        "worst_entry": worst.get("entry") or "",
        "best_response": written(value_of(row.get("best_response"))),
        "best_response_sort": value_of(row.get("best_response")),
        "measures": [
            {
                "text": _in_column(measures.get(name), wording.measure_of(name).style),
                "sort": finite(measures.get(name)),
            }
            for name in names
        ],
    }


def entry_head(track: Row, row: Row) -> Row:
    """What stands wherever an entry is named."""
    return {
        "slug": row["slug"],
        "name": row["name"],
        "page": page_of(track, row),
        "algorithm": row.get("algorithm") or "",
        "authors": ", ".join(map(str, row.get("authors") or [])),
        "kind": KINDS.get(str(row.get("kind")), "submitted"),
        "verified": is_verified(row),
        "reason": row.get("reason") or "",
        "few_seeds": bool(row.get("few_seeds")),
        "rank": wording.rank_text(row.get("rank")) if is_verified(row) else wording.NONE,
        "lost": wording.lost_text(row.get("lost"), row.get("rounds")),
    }


def value_of(interval: Any) -> float | None:
    """The value of an interval, None where there is none."""
    return finite(interval.get("value")) if isinstance(interval, dict) else None


def _lead(row: Row) -> float | None:
    return finite(row.get("lead")) if is_verified(row) else None


def share_text(value: Any) -> str:
    """A share in whole per cent."""
    number = finite(value)
    return wording.NONE if number is None else f"{100 * number:.0f} %"


def _strengths(track: Row, rows: list[Row]) -> list[Row]:
    """The score of each entry against each pairing of the panel, tinted."""
    names = list(track.get("entries") or [])
    shown = [row for row in rows if is_verified(row) and row.get("entries")]
    values = [
        value for row in shown for cell in row["entries"].values() if (value := value_of(cell)) is not None
    ]
    domain = (0.0, max([100.0, *values]))
    return [
        {**entry_head(track, row), "cells": [_cell(row["entries"].get(name), domain) for name in names]}
        for row in shown
    ]


def _cell(interval: Any, domain: drawing.Domain) -> Row:
    value = value_of(interval)
    text = wording.NONE if value is None else written(value, "whole")
    return {"text": text, "heat": drawing.heat(value, domain)}


def _leaders(rows: list[Row]) -> list[str]:
    """Who can't be told apart from the best."""
    first = [row for row in rows if is_verified(row) and (row.get("rank") or [0])[0] == 1]
    return [row["name"] for row in first]
