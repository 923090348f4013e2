"""What an entry's own page shows, taken from a board."""

from __future__ import annotations

from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.views import (
    Names,
    axis_of,
    entry_head,
    fields_of,
    gap_of,
    is_verified,
    met,
    planner_marks,
    score_of,
    seeds_gap_text,
    value_of,
    worst_view,
)
from fpg_bench.leaderboard.site.wording import finite, written

Row = dict[str, Any]


def entry_view(track: Row, row: Row, names: Names) -> Row:
    """What an entry's own page shows.

    Args:
        track: of a board.
        row: the entry's, of that track.
        names: see :func:`fpg_bench.leaderboard.site.views.names_of`.
    """
    fields, score = fields_of(track), row.get("score") or {}
    ranked_by = track.get("ranked_by") or "known"
    role = ranked_by if score_of(row, ranked_by) else "known"  # that its score is over
    domain = drawing.domain_of(_intervals(row))
    return {
        **entry_head(track, row),
        "track": track["title"],
        "key": track["key"],
        "entrants": sum(is_verified(other) and bool(other.get("rank")) for other in track["rows"]),
        "ranked_by": wording.role_of(ranked_by).label.lower(),
        "role": wording.role_of(role).label.lower(),
        "scale": wording.scale_text(track.get("scale"), track.get("side")),
        "score": written(score.get("value")),
        "interval": wording.interval_text(score),
        "over": score.get("over") or "",
        "gap": "" if gap_of(row) is None else wording.signed(gap_of(row)),
        "seeds_gap": seeds_gap_text(row),
        "worst": {
            **worst_view(track, row, names),
            "picture": drawing.interval_picture(row.get("worst"), domain),
        },
        "axis": axis_of(domain),
        "scores": [_over_field(field, row, domain) for field in fields if score_of(row, field["role"])],
        "fields": [
            field
            | {
                "rows": [
                    _scored(name, met(row, field["role"]).get(name), domain) for name in field["counterparts"]
                ]
            }
            for field in fields
            if field["role"] != "public" and met(row, field["role"])
        ],
        "seeds": _seeds(row, domain),
        "measures": _measures(row.get("measures") or {}),
        "histograms": _histograms(row.get("histograms")),
        "planner": _planner(row, domain),
        **_about(row),
    }


def _intervals(row: Row) -> list[Any]:
    """All scores that the page draws."""
    planner = row.get("planner") if isinstance(row.get("planner"), dict) else {}
    seeds = [{"value": value} for value in (row.get("seeds") or {}).values()]
    of_fields = [one for role in row.get("counterparts") or {} for one in met(row, role).values()]
    scores = [score_of(row, role) for role in row.get("scores") or {}]
    return [row.get("worst"), *scores, *of_fields, *seeds, *((planner or {}).get("curve") or [])]


def _over_field(field: Row, row: Row, domain: drawing.Domain) -> Row:
    found = score_of(row, field["role"])
    return {**_scored(field["label"], found, domain), "about": field["about"], "field": field["name"]}


def _one_by_one(field: Row, found: Row, domain: drawing.Domain) -> Row:
    return field | {"rows": [_scored(name, found.get(name), domain) for name in field["counterparts"]]}


def _scored(name: str, interval: Any, domain: drawing.Domain) -> Row:
    return {
        "name": name,
        "score": written(value_of(interval)),
        "interval": wording.interval_text(interval),
        "picture": drawing.interval_picture(interval, domain),
    }


def _seeds(row: Row, domain: drawing.Domain) -> list[Row]:
    """The score of each training seed; none for scripts."""
    seeds = row.get("seeds") or {}
    return [
        {
            "seed": seed,
            "score": written(value),
            "picture": drawing.interval_picture({"value": value}, domain),
        }
        for seed, value in seeds.items()
        if finite(value) is not None and seed != "None"
    ]


def _measures(found: Row) -> list[Row]:
    names = [name for name in wording.MEASURES if name in found]
    names += [name for name in found if name not in wording.MEASURES]
    listed = [(name, wording.measure_of(name)) for name in names if name not in wording.HIDDEN]
    return [
        {"label": told.label, "text": written(found[name], told.style), "about": told.about}
        for name, told in listed
        if finite(found[name]) is not None
    ]


def _planner(row: Row, domain: drawing.Domain) -> Row | None:
    """What is told of planners alone: how the score grows over a match's rounds, and what they asked."""
    found = row.get("planner")
    if not isinstance(found, dict):
        return None
    curve = [_scored(str(k), score, domain) for k, score in enumerate(found.get("curve") or [], 1)]
    facts = [
        ("Knows", str(found.get("tier") or wording.NONE)),
        ("Score over all rounds", written(value_of(found.get("score_all")))),
        ("Plans of its own", written(found.get("valid"), "share")),
        ("Tokens a plan", written(found.get("tokens"), "whole")),
        *((label, says) for label, says, _ in planner_marks(row)),
    ]
    return {"curve": curve, "facts": [fact for fact in facts if fact[1] != wording.NONE]}


def _histograms(found: Any) -> list[Row]:
    """The time that both sides spend on each frequency point."""
    titles = (("ally", "Where the ally transmits"), ("jam", "Where the opponent jams"))
    drawn = [
        {"side": side, "title": title, "picture": drawing.histogram_picture((found or {}).get(side))}
        for side, title in titles
    ]
    return [one for one in drawn if one["picture"] is not None]


def _about(row: Row) -> Row:
    training = row.get("training")
    return {
        "reference": wording.safe_link(row.get("reference")),
        "licence": row.get("licence") or "",
        "saw": row.get("saw") or "",
        "unable": row.get("unable") or "",
        "description": row.get("description") or "",
        "training": None
        if not isinstance(training, dict)
        else {
            "steps": written(training.get("steps"), "whole"),
            "hours": written(training.get("hours"), "step"),
            "seeds": ", ".join(map(str, training.get("seeds") or [])) or wording.NONE,
        },
        "fingerprint": _flat(row.get("fingerprint") or {}),
    }


def _flat(content: Row) -> list[tuple[str, str]]:
    """A fingerprint as lines: nested mappings with their names joined."""
    lines = []
    for key, value in content.items():
        name = str(key).replace("_", " ")
        if isinstance(value, dict):
            lines += [(f"{name} {inner}", text) for inner, text in _flat(value)]
        else:
            lines.append((name, wording.NONE if value is None else str(value)))
    return lines
