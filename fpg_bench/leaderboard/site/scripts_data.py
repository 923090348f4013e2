"""What the pages' scripts read: parts of a board as JavaScript, as nothing can be fetched from a disk."""

from __future__ import annotations

from typing import Any

from fpg_bench.evaluation.statistics import student_t
from fpg_bench.leaderboard.crossplay import WITHIN
from fpg_bench.leaderboard.site.shown import (
    Row,
    Score,
    ShownEntry,
    ShownField,
    ShownTrack,
    names_of,
    read_tracks,
    value_of,
)
from fpg_bench.leaderboard.site.views import entry_head
from fpg_bench.leaderboard.site.wording import HIDDEN, MEASURES, finite, measure_of
from fpg_bench.pictures.replay import script_json
from fpg_bench.players.player import SIDES

MOST_UNITS = 201  # that a difference is over; with more, Student's t hardly changes


def data_file(content: Any) -> str:
    """A script that hands its content to the page."""
    return f"window.fpgData = {script_json(content)};\n"


def compare_data(board: Row) -> Row:
    """Per track all ranked entries, for two of them to be laid side by side."""
    tracks = read_tracks(board)
    used = [*MEASURES, *sorted({name for track in tracks for of in track.entries for name in of.measures})]
    measures = {name: measure_of(name)._asdict() for name in used if name not in HIDDEN}
    quantiles = [round(student_t(count), 4) for count in range(2, MOST_UNITS + 1)]
    return {"measures": measures, "student": quantiles, "tracks": [_compared(track) for track in tracks]}


def _compared(track: ShownTrack) -> Row:
    fields = [field for field in track.fields if field.role != "public"]
    kept = ("role", "label", "about", "counterparts")
    return {
        "key": track.key,
        "title": track.title,
        "ranked_by": track.ranked_by,
        "fields": [{name: getattr(field, name) for name in kept} for field in fields],
        "rows": [_entry(fields, entry) for entry in track.entries if entry.verified],
        "improvement": _improvement(track),
    }


def _entry(fields: list[ShownField], entry: ShownEntry) -> Row:
    head, training = entry_head(entry), entry.row.get("training")
    kept = ("slug", "name", "page", "rank", "kind", "algorithm", "authors", "few_seeds")
    return {
        **{name: head[name] for name in kept},
        "score": interval_list(entry.score),
        "gap": rounded(entry.gap, 1),
        "worst": rounded(value_of(entry.worst), 1),
        "scores": {field.role: interval_list(entry.scores.get(field.role)) for field in fields},
        "met": {field.role: _met(field, entry) for field in fields},
        "units": {field.role: _units(field, entry) for field in fields},
        "measures": {name: rounded(value, 4) for name, value in entry.measures.items()},
        "training": training if isinstance(training, dict) else None,
    }


def _met(field: ShownField, entry: ShownEntry) -> list[list[float | None]]:
    """The score against each counterpart of a field, in its order."""
    found = entry.met.get(field.role, {})
    return [interval_list(found.get(name)) for name in field.counterparts]


def _units(field: ShownField, entry: ShownEntry) -> Row | None:
    """The scores that its intervals are over, by counterpart; None where a board has not one list of each."""
    found = (entry.row.get("units") or {}).get(field.role) or {}
    scores = [_numbers(of, 1) for of in found.get("scores") or []]
    whole = len(scores) == len(field.counterparts) and len({len(of) for of in scores}) == 1
    if not whole or not scores[0] or any(None in of for of in scores):
        return None
    return {"over": str(found.get("over") or ""), "scores": scores}


def interval_list(score: Score | None) -> list[float | None]:
    """``[value, low, high]`` of a score, each None where it is missing."""
    ends = (None,) * 3 if score is None else (score.value, score.low, score.high)
    return [rounded(end, 1) for end in ends]


def rounded(value: Any, digits: int) -> float | None:
    """A number with so many digits, None where there is none."""
    number = finite(value)
    return None if number is None else round(number, digits)


def statistics_data(board: Row) -> Row:
    """Per track the performance profiles and the probability of improvement."""
    tracks = []
    for row, track in zip(board["tracks"], read_tracks(board), strict=True):
        names, profiles = {of["slug"]: of["name"] for of in row["rows"]}, track.profiles
        share = {slug: _numbers(line, 3) for slug, line in (profiles.get("share") or {}).items()}
        order = [entry.slug for entry in track.entries]
        tracks.append(
            {
                "key": track.key,
                "title": track.title,
                "names": names,
                "order": order,
                "thresholds": _numbers(profiles.get("thresholds") or [], 1),
                "share": {slug: share[slug] for slug in order if slug in share},
                "improvement": _improvement(track, order),
            }
        )
    return {"tracks": tracks}


def _improvement(track: ShownTrack, order: list[str] | None = None) -> Row | None:
    """The matrices of the probability of improvement, with their entries in another order if one is given."""
    found = track.improvement
    if not found.get("names"):
        return None
    names = list(found["names"])
    places = [names.index(slug) for slug in order if slug in names] if order else range(len(names))
    matrices = {
        key: [[rounded(found[key][i][j], 3) for j in places] for i in places]
        for key in ("value", "low", "high")
    }
    return {"names": [names[i] for i in places], **matrices}


def _numbers(values: Any, digits: int) -> list[float | None]:
    return [rounded(value, digits) for value in values]


def crossplay_data(board: Row) -> Row | None:
    """Allies against opponents, who is missing there, and the Nash mixture; None where nobody is there.

    Opponents that are one player in two tables, and fare alike in both, are shown once.
    """
    found = board.get("crossplay")
    if not isinstance(found, dict) or not found.get("allies") or not found.get("opponents"):
        return None
    names, missing = names_of(read_tracks(board)), found.get("missing") or {}
    matrices = {**found["returns"], "jammed": found["jamming_success_rate"]}
    twins = _twins(found, matrices)
    left = [j for j, slug in enumerate(found["opponents"]) if slug not in twins]
    called = {side: names.get(side, {}) for side in SIDES}
    return {
        "names": called,
        "missing": [called[side].get(slug, slug) for side in SIDES for slug in missing.get(side) or []],
        "twins": [[called["opponent"].get(slug, slug) for slug in pair] for pair in twins.items()],
        "allies": list(found["allies"]),
        "opponents": [found["opponents"][j] for j in left],
        "matrices": {
            key: [[rounded(line[j], 4) for j in left] for line in matrix] for key, matrix in matrices.items()
        },
        "half": {
            side: [[rounded(line[j], 4) for j in left] for line in matrix]
            for side, matrix in (found.get("half") or {}).items()
        },
        "rounds": finite(found.get("rounds")),
        "nash": _nash(found.get("nash"), twins),
    }


def _twins(found: Row, matrices: dict[str, list[list[float]]]) -> dict[str, str]:
    """Opponents that are left out, each with the one that is shown in its place."""
    place = {slug: j for j, slug in enumerate(found["opponents"])}
    out: dict[str, str] = {}
    for first, *others in found.get("twins") or []:
        columns = [place[slug] for slug in (first, *others)]
        for slug, column in zip(others, columns[1:], strict=True):
            if all(_alike(matrix, columns[0], column) for matrix in matrices.values()):
                out[slug] = first
    return out


def _alike(matrix: list[list[float]], one: int, other: int) -> bool:
    """Whether two columns are as near to each other as when they are played again."""
    numbers = [value for line in matrix for value in line]
    return all(abs(line[one] - line[other]) <= WITHIN * (max(numbers) - min(numbers)) for line in matrix)


def _nash(found: Any, twins: dict[str, str]) -> Row | None:
    """The mixtures, in which one player has the shares of all its tables."""
    if not isinstance(found, dict):
        return None
    shares: Row = {side: {} for side in SIDES}
    for side in SIDES:
        for slug, share in (found.get(side) or {}).items():
            name = twins.get(slug, slug) if side == "opponent" else slug
            shares[side][name] = shares[side].get(name, 0.0) + (finite(share) or 0.0)
    return {**shares, "value": finite(found.get("value"))}
