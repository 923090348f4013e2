"""What the pages' scripts read: parts of a board as JavaScript, as nothing can be fetched from a disk."""

from __future__ import annotations

from typing import Any

from fpg_bench.envs.replay import script_json
from fpg_bench.leaderboard.site.views import entry_head, is_verified, ordered
from fpg_bench.leaderboard.site.wording import MEASURES, finite, measure_of
from fpg_bench.players.player import SIDES

Row = dict[str, Any]


def data_file(content: Any) -> str:
    """A script that hands its content to the page."""
    return f"window.fpgData = {script_json(content)};\n"


def compare_data(board: Row) -> Row:
    """Per track all ranked entries, for two of them to be laid side by side."""
    measures = {name: measure_of(name)._asdict() for name in MEASURES}
    return {"measures": measures, "tracks": [_compared(track) for track in board["tracks"]]}


def _compared(track: Row) -> Row:
    rows = [row for row in ordered(track["rows"]) if is_verified(row)]
    return {
        "key": track["key"],
        "title": track["title"],
        "entries": list(track.get("entries") or []),
        "rows": [_entry(track, row) for row in rows],
        "improvement": _improvement(track),
    }


def _entry(track: Row, row: Row) -> Row:
    head = entry_head(track, row)
    kept = ("slug", "name", "page", "rank", "kind", "algorithm", "authors", "few_seeds")
    entries = row.get("entries") or {}
    return {
        **{name: head[name] for name in kept},
        "score": interval_list(row.get("score")),
        "lead": rounded(row.get("lead"), 3),
        "mean": rounded(row.get("mean"), 1),
        "entries": {name: interval_list(entries.get(name)) for name in track.get("entries") or []},
        "measures": {name: rounded(value, 4) for name, value in (row.get("measures") or {}).items()},
        "training": row.get("training") if isinstance(row.get("training"), dict) else None,
    }


def interval_list(interval: Any) -> list[float | None]:
    """``[value, low, high]`` of an interval, each None where it is missing."""
    found = interval if isinstance(interval, dict) else {}
    return [rounded(found.get(key), 1) for key in ("value", "low", "high")]


def rounded(value: Any, digits: int) -> float | None:
    """A number with so many digits, None where there is none."""
    number = finite(value)
    return None if number is None else round(number, digits)


def statistics_data(board: Row) -> Row:
    """Per track the performance profiles and the probability of improvement."""
    tracks = []
    for track in board["tracks"]:
        names = {row["slug"]: row["name"] for row in track["rows"]}
        profiles = track.get("profiles") or {}
        share = {slug: _numbers(line, 3) for slug, line in (profiles.get("share") or {}).items()}
        order = [row["slug"] for row in ordered(track["rows"])]
        tracks.append(
            {
                "key": track["key"],
                "title": track["title"],
                "names": names,
                "order": order,
                "thresholds": _numbers(profiles.get("thresholds") or [], 1),
                "share": {slug: share[slug] for slug in order if slug in share},
                "improvement": _improvement(track, order),
            }
        )
    return {"tracks": tracks}


def _improvement(track: Row, order: list[str] | None = None) -> Row | None:
    """The matrices of the probability of improvement, with their entries in another order if one is given."""
    found = track.get("improvement")
    if not isinstance(found, dict) or not found.get("names"):
        return None
    names = list(found["names"])
    places = [names.index(slug) for slug in order if slug in names] if order else range(len(names))
    matrices = {
        key: [[rounded(found[key][i][j], 3) for j in places] for i in places]
        for key in ("value", "low", "high")
    }
    return {"names": [names[i] for i in places], **matrices}


def _names(board: Row, side: str) -> dict[str, str]:
    """What the players of a side are called, by the names of their folders."""
    tracks = [track for track in board["tracks"] if track.get("side") == side]
    return {row["slug"]: row["name"] for track in tracks for row in track["rows"]}


def _numbers(values: Any, digits: int) -> list[float | None]:
    return [rounded(value, digits) for value in values]


def crossplay_data(board: Row) -> Row | None:
    """Allies against opponents, who is missing there, and the Nash mixture; None where nobody is there."""
    found = board.get("crossplay")
    if not isinstance(found, dict) or not found.get("allies") or not found.get("opponents"):
        return None
    nash = found.get("nash") if isinstance(found.get("nash"), dict) else None
    names, missing = {side: _names(board, side) for side in SIDES}, found.get("missing") or {}
    return {
        "names": names,
        "missing": [names[side].get(slug, slug) for side in SIDES for slug in missing.get(side) or []],
        "allies": list(found["allies"]),
        "opponents": list(found["opponents"]),
        "rates": [_numbers(line, 4) for line in found["jamming_success_rate"]],
        "rounds": finite(found.get("rounds")),
        "nash": nash and {key: nash.get(key) for key in ("ally", "opponent", "value")},
    }
