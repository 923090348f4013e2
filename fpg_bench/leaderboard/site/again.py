"""How an entry is played and trained again, how it is cited, and its badge."""

from __future__ import annotations

import re
from typing import Any

from fpg_bench.leaderboard.site import wording
from fpg_bench.leaderboard.site.shown import Row, ShownEntry, ShownTrack, value_of
from fpg_bench.leaderboard.site.wording import finite, written

_CHAR_PX = 6.6  # of a badge's letters, about
_SPECIAL = re.compile(r"([&%$#_{}])")


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
    note = f"Entry {track.key}/{entry.slug}, protocol {about.get('protocol')}{_season(about)}"
    fields = {
        "author": authors,
        "title": f"{{{_plain(entry.name)}}}: entry of the fpg-bench leaderboard",
        "year": year,
        "note": _plain(note),
        "url": wording.safe_link(entry.row.get("reference")) or "",
    }
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@misc{{fpg-bench-{track.key}-{entry.slug},", *lines, "}"])


def _season(about: Row) -> str:
    season = finite(about.get("season"))
    return "" if season is None else f", season {season:.0f}"


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
