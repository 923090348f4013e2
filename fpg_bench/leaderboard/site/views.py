"""What the tables show, taken from a board: plain words and numbers, ready for the templates.

A board is data from outside (see :func:`fpg_bench.leaderboard.board.make_board`): a number may be missing,
a text may hold anything. Templates escape all text; what becomes part of a file's name is checked here.
"""

from __future__ import annotations

from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.wording import finite, written

Row = dict[str, Any]
Names = dict[str, dict[str, str]]  # what the players of each side are called, by the names of their folders
KINDS = {"script": "script", "zoo": "zoo", "submitted": "submitted"}
FEW_SEEDS = "fewer than three training seeds: its interval says little"
_HEAT = ("known", "unseen")  # whose counterparts stand in the table of strengths
_CROSSPLAY = "cross-play"


def check_board(board: Row) -> None:
    """Raise UserError where a track or an entry has a name that can't be part of a file's."""
    for track in board["tracks"]:
        key = wording.safe_slug(track["key"], "track")
        for row in track["rows"]:
            wording.safe_slug(row["slug"], f"entry of {key}")


def names_of(board: Row) -> Names:
    """What the players of each side are called, by the names of their folders."""
    found: Names = {}
    for track in board["tracks"]:
        side = found.setdefault(str(track.get("side")), {})
        side |= {row["slug"]: row["name"] for row in track["rows"]}
    return found


def is_verified(row: Row) -> bool:
    """Whether an entry's result counts."""
    return row.get("status") == "verified"


def ordered(rows: list[Row]) -> list[Row]:
    """Entries by score; those without a rank after them, those that are not verified last."""

    def place(row: Row) -> tuple[bool, bool, float, str]:
        score = value_of(row.get("score"))
        return not is_verified(row), not row.get("rank"), -(score if score is not None else -1e9), row["slug"]

    return sorted(rows, key=place)


def page_of(track: Row, row: Row) -> str:
    """The address of an entry's page, from the site's root."""
    return f"entries/{track['key']}/{row['slug']}.html"


def fields_of(track: Row) -> list[Row]:
    """The fields of a track in the order in which pages list them, each with what it is called."""
    places = {role: place for place, role in enumerate(wording.ROLES)}
    fields = sorted(track.get("fields") or [], key=lambda field: places.get(field["role"], len(places)))
    return [{**field, **wording.role_of(field["role"])._asdict()} for field in fields]


def track_view(track: Row, names: Names) -> Row:
    """What the front page shows of a track.

    Args:
        track: of a board.
        names: see :func:`names_of`.
    """
    rows, ranked_by = ordered(track["rows"]), track.get("ranked_by") or "known"
    columns = _columns(rows, ranked_by)
    domain = drawing.domain_of([score_of(row, ranked_by) for row in rows])
    ranking = next((field for field in fields_of(track) if field["role"] == ranked_by), None)
    return {
        "key": track["key"],
        "title": track["title"],
        "side": track.get("side"),
        "ranked_by": wording.role_of(ranked_by).label.lower(),
        "field": ranking,
        "scale": wording.scale_text(track.get("scale"), track.get("side")),
        "columns": columns,
        "axis": axis_of(domain),
        "rows": [_row_view(track, row, columns, domain, names) for row in rows],
        "strengths": _strengths(track, rows),
        "leaders": _leaders(rows),
    }


def _columns(rows: list[Row], ranked_by: str) -> Row:
    """Which columns stand in the table: those that any entry has something for."""
    measured = {name for row in rows for name in (row.get("measures") or {})}
    return {
        "ranked_by": ranked_by,
        "shifted": any(score_of(row, "shifted") for row in rows),
        "measures": [
            {"name": name, **wording.measure_of(name)._asdict()}
            for name in wording.COLUMNS
            if name in measured
        ],
    }


def axis_of(domain: drawing.Domain) -> Row:
    """Where the marks of 0 and 100 stand."""
    return {"zero": drawing.place(0, domain), "hundred": drawing.place(100, domain)}


def score_of(row: Row, role: str) -> Row:
    """An entry's score over the field of a role, with its interval; empty where it has none."""
    found = (row.get("scores") or {}).get(role)
    return found if isinstance(found, dict) else {}


def gap_of(row: Row) -> float | None:
    """By how much an entry scores more against whom everybody knows than against whom nobody had met."""
    known, unseen = (value_of(score_of(row, role)) for role in ("known", "unseen"))
    return None if known is None or unseen is None else known - unseen


def _row_view(track: Row, row: Row, columns: Row, domain: drawing.Domain, names: Names) -> Row:
    measures, score = row.get("measures") or {}, score_of(row, columns["ranked_by"])
    return {
        **entry_head(track, row),
        "score": shown(value_of(score)),
        "interval": wording.interval_text(score),
        "over": score.get("over") or "",
        "picture": drawing.interval_picture(score, domain),
        "rank_sort": finite((row.get("rank") or [None])[0]),
        "known": shown(value_of(score_of(row, "known"))),
        "gap": {"text": wording.signed(gap_of(row)), "sort": gap_of(row)},
        "shifted": shown(value_of(score_of(row, "shifted"))),
        "worst": worst_view(track, row, names),
        "seeds_gap": seeds_gap_text(row),
        "measures": [shown(measures.get(column["name"]), column["style"]) for column in columns["measures"]],
    }


def shown(value: Any, style: str = "score") -> Row:
    """A number as a cell: its text, and what it is sorted by."""
    return {"text": written(value, style), "sort": finite(value)}


def worst_view(track: Row, row: Row, names: Names) -> Row:
    """The lowest score that is known of an entry: who did it, where, and the return a step."""
    worst = row.get("worst") or {}
    other = "opponent" if track.get("side") == "ally" else "ally"
    against, where = str(worst.get("against") or ""), str(worst.get("where") or "")
    if where == _CROSSPLAY:
        against = names.get(other, {}).get(against, against)
    fields = [field for field in fields_of(track) if field["role"] != "public"]  # of the known one's name
    roles = {field["name"]: field["label"].lower() for field in fields}
    return {
        **shown(value_of(worst)),
        "interval": wording.interval_text(worst),
        "against": against,
        "where": roles.get(where, where),
        "return": written(value_of(worst.get("return")), "step"),
    }


def seeds_gap_text(row: Row) -> str:
    """A sentence where an entry does better on the seeds that everybody knew than others do; else empty."""
    gap = row.get("seeds_gap")
    if not isinstance(gap, dict) or not gap.get("flagged"):
        return ""
    return f"scores {written(gap.get('value'))} more on the seeds that everybody knew"


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
        "had_access": bool(row.get("had_access")),
        "rank": wording.rank_text(row.get("rank")) if is_verified(row) else wording.NONE,
        "lost": wording.lost_text(row.get("lost"), row.get("rounds")),
        "marks": [f"{label}: {says}" for label, says, flagged in planner_marks(row) if flagged],
    }


def planner_marks(row: Row) -> list[tuple[str, str, bool]]:
    """A planner's marks: what each is about, what it says, and whether it is flagged; none of players."""
    marks = (row.get("planner") or {}).get("marks") or {}
    labels = {"first_round": "First round", "shuffled_rewards": "Rewards shuffled"}
    return [
        (label, str(marks[name].get("says")), marks[name].get("flagged") is True)
        for name, label in labels.items()
        if isinstance(marks.get(name), dict)
    ]


def value_of(interval: Any) -> float | None:
    """The value of an interval, None where there is none."""
    return finite(interval.get("value")) if isinstance(interval, dict) else None


def met(row: Row, role: str) -> Row:
    """An entry's scores against each counterpart of the field of a role."""
    found = (row.get("counterparts") or {}).get(role)
    return found if isinstance(found, dict) else {}


def _strengths(track: Row, rows: list[Row]) -> Row:
    """The score of each entry against each counterpart that is known or unseen, tinted."""
    fields = [field for field in fields_of(track) if field["role"] in _HEAT]
    met_by = [row for row in rows if is_verified(row) and row.get("counterparts")]
    values = [
        value
        for row in met_by
        for field in fields
        for cell in met(row, field["role"]).values()
        if (value := value_of(cell)) is not None
    ]
    domain = (0.0, max([100.0, *values]))
    return {
        "fields": fields,
        "rows": [
            {
                **entry_head(track, row),
                "cells": [
                    _cell(met(row, field["role"]).get(name), domain)
                    for field in fields
                    for name in field["counterparts"]
                ],
            }
            for row in met_by
        ],
    }


def _cell(interval: Any, domain: drawing.Domain) -> Row:
    value = value_of(interval)
    text = wording.NONE if value is None else written(value, "whole")
    return {"text": text, "heat": drawing.heat(value, domain)}


def _leaders(rows: list[Row]) -> list[str]:
    """Who may be first: the best by score, and all that can't be told apart from it."""
    first = [row for row in rows if is_verified(row) and (row.get("rank") or [0])[0] == 1]
    return [row["name"] for row in first]
