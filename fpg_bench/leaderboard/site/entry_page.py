"""What an entry's own page shows, taken from a board."""

from __future__ import annotations

from typing import Any

from fpg_bench.leaderboard.site import again, drawing, wording
from fpg_bench.leaderboard.site.shown import (
    Names,
    Row,
    Score,
    ShownEntry,
    ShownField,
    ShownTrack,
    score_of,
    value_of,
)
from fpg_bench.leaderboard.site.views import axis_of, entry_head, planner_marks, seeds_gap_text, worst_view
from fpg_bench.leaderboard.site.wording import finite, written


def entry_view(track: ShownTrack, entry: ShownEntry, names: Names, about: Row) -> Row:
    """What an entry's own page shows.

    Args:
        track: of a board.
        entry: of that track.
        names: see :func:`fpg_bench.leaderboard.site.shown.names_of`.
        about: what the board says of itself.
    """
    score, gap = entry.score, entry.gap
    role = track.ranked_by if track.ranked_by in entry.scores else "known"  # that its score is over
    domain = drawing.domain_of(_scores(entry))
    return {
        **entry_head(entry),
        "track": track.title,
        "key": track.key,
        "ranked": sum(other.verified and bool(other.rank) for other in track.entries),
        "ranked_by": wording.role_of(track.ranked_by).label.lower(),
        "role": wording.role_of(role).label.lower(),
        "scale": wording.scale_text(track.scale, track.side),
        "score": written(value_of(score)),
        "interval": wording.interval_text(score),
        "over": "" if score is None else score.over,
        "gap": "" if gap is None else wording.signed(gap),
        "seeds_gap": seeds_gap_text(entry),
        "worst": {
            **worst_view(track, entry, names),
            "picture": drawing.interval_picture(entry.worst, domain),
        },
        "axis": axis_of(domain),
        "scores": [
            {**_scored(field.label, over, domain), "about": field.about, "field": field.name}
            for field in track.fields
            if (over := entry.scores.get(field.role)) is not None
        ],
        "fields": [
            _one_by_one(field, entry, domain)
            for field in track.fields
            if field.role != "public" and entry.met.get(field.role)
        ],
        "seeds": _seeds(entry, domain),
        "measures": _measures(entry.measures),
        "histograms": _histograms(entry.row.get("histograms")),
        "planner": _planner(entry, domain),
        "commands": again.commands(track, entry),
        "bibtex": again.bibtex(track, entry, about),
        "badge": again.badge_file(track, entry),
        "never_met": again.never_met(track, entry),
        **_about(entry.row),
    }


def _scores(entry: ShownEntry) -> list[Score | None]:
    """All scores that the page draws."""
    seeds = [Score(finite(value)) for value in entry.seeds.values()]
    met = [one for of in entry.met.values() for one in of.values()]
    return [entry.worst, *entry.scores.values(), *met, *seeds, *_curve(entry)]


def _curve(entry: ShownEntry) -> list[Score | None]:
    return [score_of(found) for found in entry.planner.get("curve") or []]


def _one_by_one(field: ShownField, entry: ShownEntry, domain: drawing.Domain) -> Row:
    found = entry.met[field.role]
    rows = [_scored(name, found.get(name), domain) for name in field.counterparts]
    return {"role": field.role, "name": field.name, "label": field.label, "rows": rows}


def _scored(name: str, score: Score | None, domain: drawing.Domain) -> Row:
    return {
        "name": name,
        "score": written(value_of(score)),
        "interval": wording.interval_text(score),
        "picture": drawing.interval_picture(score, domain),
    }


def _seeds(entry: ShownEntry, domain: drawing.Domain) -> list[Row]:
    """The score of each training seed; none for scripts."""
    scores = {seed: finite(value) for seed, value in entry.seeds.items() if seed != "None"}
    return [
        {"seed": seed, "score": written(value), "picture": drawing.interval_picture(Score(value), domain)}
        for seed, value in scores.items()
        if value is not None
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


def _planner(entry: ShownEntry, domain: drawing.Domain) -> Row | None:
    """What is told of planners alone: how the score grows over a match's rounds, and what they asked."""
    found = entry.planner
    if not isinstance(entry.row.get("planner"), dict):
        return None
    curve = [_scored(str(k), score, domain) for k, score in enumerate(_curve(entry), 1)]
    facts = [
        ("Knows", str(found.get("tier") or wording.NONE)),
        ("Score over all rounds", written(value_of(score_of(found.get("score_all"))))),
        ("Plans of its own", written(found.get("valid"), "share")),
        ("Valid but useless", written(found.get("valid_but_useless"), "share")),
        ("Runs made, this one with them", written(found.get("runs"), "whole")),
        ("Begun after season", written(found.get("season"), "whole")),
        ("Tokens a plan", written(found.get("tokens"), "whole")),
        *((label, says) for label, says, _ in planner_marks(entry)),
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
