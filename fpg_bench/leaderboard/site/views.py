"""What the tables show, taken from a board: plain words and numbers, ready for the templates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.shown import Names, Row, Score, ShownEntry, ShownTrack, score_of, value_of
from fpg_bench.leaderboard.site.wording import finite, written

FEW_SEEDS = "fewer than three training seeds: its interval says little"
_HEAT = ("known", "unseen")  # whose counterparts stand in the table of strengths
_CROSSPLAY = "cross-play"


def track_view(track: ShownTrack, names: Names) -> Row:
    """What the front page shows of a track.

    Args:
        track: of a board.
        names: see :func:`fpg_bench.leaderboard.site.shown.names_of`.
    """
    columns = _columns(track)
    domain = drawing.domain_of([entry.scores.get(track.ranked_by) for entry in track.entries])
    ranking = next((field for field in track.fields if field.role == track.ranked_by), None)
    return {
        "key": track.key,
        "title": track.title,
        "side": track.side,
        "ranked_by": wording.role_of(track.ranked_by).label.lower(),
        "field": ranking,
        "scale": wording.scale_text(track.scale, track.side),
        "columns": columns,
        "axis": axis_of(domain),
        "rows": [_row_view(track, entry, columns, domain, names) for entry in track.entries],
        "strengths": _strengths(track),
        "leaders": _leaders(track.entries),
    }


def _columns(track: ShownTrack) -> Row:
    """Which columns stand in the table: those that any entry has something for."""
    measured = {name for entry in track.entries for name in entry.measures}
    return {
        "ranked_by": track.ranked_by,
        "shifted": any("shifted" in entry.scores for entry in track.entries),
        "measures": [
            {"name": name, **wording.measure_of(name)._asdict()}
            for name in wording.COLUMNS
            if name in measured
        ],
    }


def axis_of(domain: drawing.Domain) -> Row:
    """Where the marks of 0 and 100 stand."""
    return {"zero": drawing.place(0, domain), "hundred": drawing.place(100, domain)}


def _row_view(
    track: ShownTrack, entry: ShownEntry, columns: Row, domain: drawing.Domain, names: Names
) -> Row:
    score = entry.scores.get(track.ranked_by)
    known, shifted = (shown(value_of(entry.scores.get(role))) for role in ("known", "shifted"))
    return {
        **entry_head(entry),
        "score": shown(value_of(score)),
        "interval": wording.interval_text(score),
        "over": "" if score is None else score.over,
        "picture": drawing.interval_picture(score, domain),
        "rank_sort": finite((entry.rank or [None])[0]),
        "known": known,
        "gap": {"text": wording.signed(entry.gap), "sort": entry.gap},
        "shifted": shifted,
        "worst": worst_view(track, entry, names),
        "seeds_gap": seeds_gap_text(entry),
        "measures": [shown(entry.measures.get(of["name"]), of["style"]) for of in columns["measures"]],
    }


def shown(value: Any, style: str = "score") -> Row:
    """A number as a cell: its text, and what it is sorted by."""
    return {"text": written(value, style), "sort": finite(value)}


def worst_view(track: ShownTrack, entry: ShownEntry, names: Names) -> Row:
    """The lowest score that is known of an entry: who did it, where, and the return a step."""
    told = entry.row.get("worst") or {}
    against, where = str(told.get("against") or ""), str(told.get("where") or "")
    if where == _CROSSPLAY:
        against = names.get(track.other_side, {}).get(against, against)
    fields = [field for field in track.fields if field.role != "public"]  # of the known one's name
    roles = {field.name: field.label.lower() for field in fields}
    return {
        **shown(value_of(entry.worst)),
        "interval": wording.interval_text(entry.worst),
        "against": against,
        "where": roles.get(where, where),
        "return": written(value_of(score_of(told.get("return"))), "step"),
    }


def seeds_gap_text(entry: ShownEntry) -> str:
    """A sentence where an entry does better on the seeds that everybody knew than others do; else empty."""
    gap = entry.row.get("seeds_gap")
    if not isinstance(gap, dict) or not gap.get("flagged"):
        return ""
    return f"scores {written(gap.get('value'))} more on the seeds that everybody knew"


def entry_head(entry: ShownEntry) -> Row:
    """What stands wherever an entry is named."""
    row = entry.row
    return {
        "slug": entry.slug,
        "name": entry.name,
        "page": entry.page,
        "algorithm": row.get("algorithm") or "",
        "authors": ", ".join(map(str, row.get("authors") or [])),
        "kind": entry.kind,
        "verified": entry.verified,
        "reason": row.get("reason") or "",
        "few_seeds": bool(row.get("few_seeds")),
        "had_access": bool(row.get("had_access")),
        "rank": wording.rank_text(entry.rank) if entry.verified else wording.NONE,
        "lost": wording.lost_text(row.get("lost"), row.get("rounds")),
    }


def _strengths(track: ShownTrack) -> Row:
    """The score of each entry against each counterpart that is known or unseen, tinted."""
    fields = [field for field in track.fields if field.role in _HEAT]
    met_by = [entry for entry in track.entries if entry.verified and entry.met]
    cells = [one for entry in met_by for field in fields for one in entry.met.get(field.role, {}).values()]
    values = [value for one in cells if (value := value_of(one)) is not None]
    domain = (0.0, max([100.0, *values]))
    return {
        "fields": fields,
        "rows": [
            {
                **entry_head(entry),
                "cells": [
                    _cell(entry.met.get(field.role, {}).get(name), domain)
                    for field in fields
                    for name in field.counterparts
                ],
            }
            for entry in met_by
        ],
    }


def _cell(score: Score | None, domain: drawing.Domain) -> Row:
    value = value_of(score)
    text = wording.NONE if value is None else written(value, "whole")
    return {"text": text, "heat": drawing.heat(value, domain)}


def _leaders(entries: Sequence[ShownEntry]) -> list[str]:
    """Who may be first: the best by score, and all that can't be told apart from it."""
    return [entry.name for entry in entries if entry.verified and (entry.rank or [0])[0] == 1]
