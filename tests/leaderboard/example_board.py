"""A board for the tests of the site: any number of entries, and texts that try to become markup."""

from __future__ import annotations

import numpy as np

HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(2)>',
    "</script><script>alert(3)</script>",
    "{{ 7 * 7 }} {% raw %}",
    "javascript:alert(4)",
    "' onmouseover='alert(5)",
)
TRACKS = {
    "ally": ("Allies", "ally", ["tone", "comb", "adaptive"]),
    "opponent-pursuit": ("Opponents in pursuit", "opponent", ["idle", "expert"]),
}


SLOWER = ("checks every 3 s", "slower ally")


def example_board(
    entries: int = 6, hostile: bool = False, counterparts: int | None = None, season: int | None = 1
) -> dict:
    """A board of two tracks: so many entries, and two; season None: none is closed."""
    rng = np.random.default_rng(0)
    tracks = []
    for number, (key, (title, side, others)) in enumerate(TRACKS.items()):
        count = 2 if number else entries
        names = [f"{other}/pursuit" for other in (others if counterparts is None else range(counterparts))]
        fields = _fields(side, names, season)
        rows = [_row(rng, key, index, fields, hostile) for index in range(count)]
        ranked = [row for row in rows if row["score"]]
        for rank, row in enumerate(sorted(ranked, key=lambda row: -row["score"]["value"])):
            row["rank"] = [rank // 2 * 2 + 1, rank // 2 * 2 + 2]
        tracks.append({"key": key, "title": title, "side": side, "scale": {"zero": -5.66, "top": 22.0}})
        tracks[-1] |= {"ranked_by": _ranking(fields), "fields": fields, "rows": rows}
        slugs = [row["slug"] for row in rows if row["rank"]]
        tracks[-1] |= _statistics(rng, slugs)
    return {
        "version": "0.1.0",
        "protocol": "2",
        "season": season,
        "built": "2026-01-01",
        "tracks": tracks,
        "crossplay": _crossplay(rng, tracks, hostile),
    }


def _fields(side: str, known: list[str], season: int | None) -> list[dict]:
    """The known field alone before a season is closed, all that there can be after it."""
    fields = {"known": (f"{side}-v1", known)}
    if season is not None:
        trained = [f"trained-{k}" for k in range(3)]
        shifted = [f"{known[0]}, {change}" for change in SLOWER]
        fields |= {"public": (f"{side}-v1", known), "unseen": (f"{side}-season-{season}", trained)}
        fields |= {"shifted": (f"{side}-shifted-v1", shifted)}
    return [
        {"role": role, "name": name, "hash": "0" * 64, "rounds": 100, "counterparts": list(names)}
        for role, (name, names) in fields.items()
    ]


def _ranking(fields: list[dict]) -> str:
    return "unseen" if "unseen" in [field["role"] for field in fields] else "known"


def _row(rng, key: str, index: int, fields: list[dict], hostile: bool) -> dict:
    kind = ("script", "zoo", "submitted")[index % 3]
    scores = {field["role"]: float(rng.uniform(20, 130)) for field in fields}
    met = {
        field["role"]: {
            name: _interval(scores[field["role"]] + float(rng.normal(0, 15)), 9)
            for name in field["counterparts"]
        }
        for field in fields
    }
    score = scores[_ranking(fields)]
    text = HOSTILE[index % len(HOSTILE)] if hostile else ""
    verified = not (key == "ally" and index == 0)
    return {
        "slug": f"player-{index}",
        "name": f"Player {index} {text}".strip(),
        "authors": [f"Author {index}", text] if text else [f"Author {index}"],
        "algorithm": f"PPO {text}".strip(),
        "reference": HOSTILE[index % len(HOSTILE)] if hostile else "https://example.org/paper?a=1&b=2",
        "licence": text or "MIT",
        "kind": kind,
        "plays": {"script": ("idle", "tone")[key != "ally"], "zoo": "no-such/agent"}.get(kind),
        "status": "verified" if verified else "not verified",
        "reason": None if verified else f"seed_0: outran the limit {text}".strip(),
        "rank": None,
        "training_seeds": 0 if kind == "script" else 5,
        "few_seeds": index % 4 == 1,
        "score": _interval(score, 6) | {"over": "training seeds"} if verified else None,
        "scores": {role: _interval(value, 6) | {"over": "training seeds"} for role, value in scores.items()}
        if verified
        else {},
        "worst": _worst(index, min(met["known"].items(), key=lambda item: item[1]["value"]), fields)
        if verified
        else None,
        "counterparts": met if verified else {},
        "units": _units(met, kind) if verified else {},
        "seeds": {} if kind == "script" or not verified else {str(k): score + k - 2 for k in range(5)},
        "seeds_gap": {"value": 7.25, "flagged": True} if index == 2 else {"value": -1.0, "flagged": False},
        "had_access": index == 1,
        "measures": _measures(rng) if verified else {},
        "planner": None,
        "lost": 1234 if index == 4 else 0,
        "rounds": 5000,
        "training": None
        if kind == "script"
        else {"steps": 2_000_000, "hours": 1.5, "seeds": [0, 1, 2, 3, 4]},
        "saw": text or "the adaptive opponent in pursuit",
        "unable": text or "nothing that we know of",
        "description": text,
        "histograms": {
            "ally": rng.integers(0, 900, 15).tolist(),
            "jam": rng.integers(0, 900, 15).tolist(),
        },
        "replays": [],
        "fingerprint": {"version": "0.1.0", "policies": {"0": "ab" * 32}, "submission": text or "cd" * 32},
    }


def _units(met: dict, kind: str) -> dict:
    """Five training seeds around each score; scripts: ten matches."""
    spread = (-1, 0, 1) * 3 + (0,) if kind == "script" else (-2, -1, 0, 1, 2)
    over = "matches" if kind == "script" else "training seeds"
    return {
        role: {"over": over, "scores": [[one["value"] + k for k in spread] for one in of.values()]}
        for role, of in met.items()
    }


def _worst(index: int, lowest: tuple[str, dict], fields: list[dict]) -> dict:
    """In every third row from cross-play, as one round of a script without an interval, else from a field."""
    if index % 3 == 0:
        score = {"value": -30.0, "low": None, "high": None}
        return score | {"against": "player-1", "where": "cross-play", "return": dict(score, value=-13.96)}
    against, score = lowest
    return score | {"against": against, "where": fields[0]["name"], "return": _interval(2.5, 0.5)}


def _interval(value: float, half: float) -> dict:
    return {"value": value, "low": value - half, "high": value + half}


def _measures(rng) -> dict:
    shares = (
        "overlap_ratio",
        "jamming_success_rate",
        "spectrum_overlap",
        "outage",
        "hop_rate",
        "spread_ratio",
    )
    found = {name: float(rng.uniform(0, 0.5)) for name in shares}
    return found | {
        "return": float(rng.uniform(-5, 22)),
        "ally_return": float(rng.uniform(-500, 4000)),
        "capacity_mbit_s": 90.0,
        "snr_db": 61.25,
        "near_ratio": None,
    }


def _statistics(rng, slugs: list[str]) -> dict:
    value = rng.uniform(size=(len(slugs), len(slugs)))
    matrices = {"value": value, "low": np.maximum(value - 0.2, 0), "high": np.minimum(value + 0.2, 1)}
    thresholds = np.linspace(-20, 160, 37)
    return {
        "improvement": {"names": slugs, **{key: matrix.tolist() for key, matrix in matrices.items()}},
        "profiles": {
            "thresholds": thresholds.tolist(),
            "share": {
                slug: (1 / (1 + np.exp((thresholds - 60 - 3 * k) / 12))).tolist()
                for k, slug in enumerate(slugs)
            },
        },
    }


def _crossplay(rng, tracks: list[dict], hostile: bool) -> dict:
    allies, opponents = ([row["slug"] for row in track["rows"]] for track in tracks)
    returns = {side: rng.uniform(-10, 22, (len(allies), len(opponents))) for side in ("ally", "opponent")}
    return {
        "allies": allies,
        "opponents": opponents,
        "missing": {"ally": [], "opponent": []},
        "twins": [],
        "returns": {side: matrix.tolist() for side, matrix in returns.items()},
        "half": {
            side: [[None if k % 3 == 0 else 1.25 for k in range(len(opponents))] for _ in allies]
            for side in returns
        },
        "jamming_success_rate": rng.uniform(0, 0.4, (len(allies), len(opponents))).tolist(),
        "rounds": 100,
        "nash": {
            "ally": {allies[0]: 0.25, allies[-1]: 0.75},
            "opponent": {opponents[0]: 1.0},
            "value": -1.5,
        },
    }
