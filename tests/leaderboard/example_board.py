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


def example_board(entries: int = 6, hostile: bool = False, counterparts: int | None = None) -> dict:
    """A board of two tracks, the first with so many entries, the second with two."""
    rng = np.random.default_rng(0)
    tracks = []
    for number, (key, (title, side, others)) in enumerate(TRACKS.items()):
        count = 2 if number else entries
        names = [f"{other}/pursuit" for other in (others if counterparts is None else range(counterparts))]
        rows = [_row(rng, key, index, names, hostile) for index in range(count)]
        ranked = [row for row in rows if row["score"]]
        for rank, row in enumerate(sorted(ranked, key=lambda row: -row["score"]["value"])):
            row["rank"] = [rank // 2 * 2 + 1, rank // 2 * 2 + 2]
        tracks.append(
            {"key": key, "title": title, "side": side, "panel": f"{side}-v1", "panel_hash": "0" * 64}
        )
        tracks[-1] |= {"rounds": 100, "reference": "expert", "entries": names, "rows": rows}
        slugs = [row["slug"] for row in rows if row["rank"]]
        tracks[-1] |= _statistics(rng, slugs)
    return {
        "version": "0.1.0",
        "protocol": "1",
        "season": "0",
        "built": "2026-01-01",
        "tracks": tracks,
        "crossplay": _crossplay(rng, tracks, hostile),
    }


def _row(rng, key: str, index: int, names: list[str], hostile: bool) -> dict:
    kind = ("script", "zoo", "submitted")[index % 3]
    score = float(rng.uniform(20, 130))
    scores = {name: score + float(rng.normal(0, 15)) for name in names}
    worst = min(scores, key=lambda name: scores[name])
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
        "status": "verified" if verified else "not verified",
        "reason": None if verified else f"seed_0: outran the limit {text}".strip(),
        "rank": None,
        "lead": float(rng.uniform()),
        "training_seeds": 0 if kind == "script" else 5,
        "few_seeds": index % 4 == 1,
        "score": _interval(score, 6) | {"over": "training seeds"} if verified else None,
        "mean": score - 2 if verified else None,
        "worst": {"entry": worst, "value": scores[worst]} if verified else None,
        "entries": {name: _interval(value, 9) for name, value in scores.items()} if verified else {},
        "seeds": {} if kind == "script" or not verified else {str(k): score + k - 2 for k in range(5)},
        "measures": _measures(rng) if verified else {},
        "best_response": _interval(12.0, 3) if index == 2 else None,
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
        "return": float(rng.uniform(-500, 4000)),
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
    return {
        "allies": allies,
        "opponents": opponents,
        "jamming_success_rate": rng.uniform(0, 0.4, (len(allies), len(opponents))).tolist(),
        "rounds": 100,
        "nash": {
            "ally": {allies[0]: 0.25, allies[-1]: 0.75},
            "opponent": {opponents[0]: 1.0},
            "value": 0.18,
        },
    }
