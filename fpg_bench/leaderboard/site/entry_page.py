"""What an entry's own page shows: its scores, how it is played again and cited; and its badge."""

from __future__ import annotations

import re
from typing import Any

from fpg_bench.leaderboard.site import drawing, wording
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
from fpg_bench.leaderboard.site.views import axis_of, entry_head, seeds_gap_text, worst_view
from fpg_bench.leaderboard.site.wording import finite, written

_CHAR_PX = 6.6  # of a badge's letters, about
_SPECIAL = re.compile(r"([&%$#_{}])")


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
        "commands": commands(track, entry),
        "bibtex": bibtex(track, entry, about),
        "badge": badge_file(track, entry),
        "never_met": never_met(track, entry),
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


def commands(track: ShownTrack, entry: ShownEntry) -> list[Row]:
    """What to type to have an entry's numbers again, and where the package trained it, the entry itself."""
    side = track.key.partition("-")[0]
    found = [{"what": "Play it again and compare", "line": f"fpg-bench submit verify {side}/{entry.slug}"}]
    plays = entry.row.get("plays")
    if entry.kind == "zoo" and isinstance(plays, str):
        view = wording.safe_slug(plays.partition("/")[0], f"view of {entry.slug}")
        champion = view.endswith("champion")
        script = f"train_champions.py --only {view}" if champion else f"train_zoo.py --only {plays}"
        found.append({"what": "Train it again", "line": f"python scripts/{script}"})
    return found


def bibtex(track: ShownTrack, entry: ShownEntry, about: Row) -> str:
    """The entry as BibTeX; ``about`` is what the board says of itself."""
    authors = " and ".join(f"{{{_plain(name)}}}" for name in entry.row.get("authors") or [])
    year = str(about.get("built") or "")[:4]
    season = finite(about.get("season"))
    told = "" if season is None else f", season {season:.0f}"
    note = f"Entry {track.key}/{entry.slug}, protocol {about.get('protocol')}{told}"
    fields = {
        "author": authors,
        "title": f"{{{_plain(entry.name)}}}: entry of the fpg-bench leaderboard",
        "year": year,
        "note": _plain(note),
        "url": wording.safe_link(entry.row.get("reference")) or "",
    }
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@misc{{fpg-bench-{track.key}-{entry.slug},", *lines, "}"])


def _plain(text: Any) -> str:
    """Text as BibTeX takes it, on one line."""
    return _SPECIAL.sub(r"\\\1", " ".join(str(text).replace("\\", " ").split()))


def badge_file(track: ShownTrack, entry: ShownEntry) -> str:
    """Where an entry's badge lies in the site."""
    return f"badges/{track.key}/{entry.slug}.svg"


def badge_view(track: ShownTrack, entry: ShownEntry) -> Row:
    """What a small picture for a README says of an entry's rank and score, and how wide its parts are."""
    ranked = sum(other.verified and bool(other.rank) for other in track.entries)
    score = f"score {written(value_of(entry.score))}"
    rank = f"rank {wording.rank_text(entry.rank)} of {ranked}, " if entry.rank else ""
    texts = {"left": f"fpg-bench {track.key}", "right": rank + score}
    split, rest = (round(len(text) * _CHAR_PX) + 14 for text in texts.values())
    colour = "#00609a" if track.side == "ally" else "#ad4700"
    return {**texts, "split": split, "width": split + rest, "colour": colour}


def never_met(track: ShownTrack, entry: ShownEntry) -> Row | None:
    """Whom an entry can't have trained on: the season's field, unless it came after the season was closed."""
    field = next((field for field in track.fields if field.role == "unseen"), None)
    if field is None or entry.row.get("had_access"):
        return None
    return {"name": field.name, "counterparts": list(field.counterparts)}
