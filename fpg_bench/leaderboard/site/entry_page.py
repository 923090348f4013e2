"""What an entry's own page shows, taken from a board."""

from __future__ import annotations

from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
from fpg_bench.leaderboard.site.views import axis_of, entry_head, is_verified, share_text, value_of
from fpg_bench.leaderboard.site.wording import finite, written

Row = dict[str, Any]


def entry_view(track: Row, row: Row) -> Row:
    """What an entry's own page shows."""
    entries = row.get("entries") or {}
    names = [name for name in (track.get("entries") or []) if name in entries]
    domain = drawing.domain_of([entries[name] for name in names] + [row.get("score")])
    score, worst = row.get("score") or {}, row.get("worst") or {}
    return {
        **entry_head(track, row),
        "track": track["title"],
        "key": track["key"],
        "panel": track.get("panel"),
        "reference_player": track.get("reference"),
        "entrants": sum(map(is_verified, track["rows"])),
        "score": written(score.get("value")),
        "interval": wording.interval_text(score),
        "over": score.get("over") or "",
        "mean": written(row.get("mean")),
        "lead": share_text(row.get("lead")),
        "worst": worst.get("entry") or "",
        "worst_score": written(worst.get("value")),
        "best": _best(entries, names),
        "best_response": _best_responses(row.get("best_response")),
        "axis": axis_of(domain),
        "entries": [_scored(name, entries[name], domain) for name in names],
        "seeds": _seeds(row, domain),
        "measures": _measures(row.get("measures") or {}),
        "histograms": _histograms(row.get("histograms")),
        "planner": _planner(row.get("planner"), domain),
        **_about(row),
    }


def _best(entries: Row, names: list[str]) -> str:
    known = {name: value for name in names if (value := value_of(entries[name])) is not None}
    return max(known, key=lambda name: known[name]) if known else ""


def _best_responses(found: Any) -> str:
    if value_of(found) is None:
        return ""
    between = wording.interval_text(found)
    return written(found["value"]) + (f" ({between})" if between else "")


def _scored(name: str, interval: Row, domain: drawing.Domain) -> Row:
    return {
        "name": name,
        "score": written(interval.get("value")),
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
    hidden = {*wording.HIDDEN, *(["return"] if "ally_return" in found else [])}  # it is one of both sides'
    listed = [(name, wording.measure_of(name)) for name in names if name not in hidden]
    return [
        {"label": told.label, "text": written(found[name], told.style), "about": told.about}
        for name, told in listed
        if finite(found[name]) is not None
    ]


def _planner(found: Any, domain: drawing.Domain) -> Row | None:
    """What is told of planners alone: how the score grows over a match's rounds, and what they asked."""
    if not isinstance(found, dict):
        return None
    curve = [_scored(str(k), score, domain) for k, score in enumerate(found.get("curve") or [], 1)]
    facts = [
        ("Knows", str(found.get("tier") or wording.NONE)),
        ("Score over all rounds", written(value_of(found.get("score_all")))),
        ("Plans of its own", written(found.get("valid"), "share")),
        ("Tokens a plan", written(found.get("tokens"), "whole")),
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
            "hours": written(training.get("hours")),
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
