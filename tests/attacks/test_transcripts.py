"""A transcript that somebody spoilt is one clear line, or plays to the bit what the honest one does."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.products.language_models.transcript import Attempt
from fpg_bench.products.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.products.leaderboard.transcripts import check_transcripts
from tests.attacks import SCALE, SEED
from tests.attacks.json_texts import hostile_text
from tests.products.leaderboard.recording import PLANNER_SUITE, enter, record, rows_of, toy

Rows = list[dict[str, Any]]
_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 2**31, 10**39, 1.5, 1e308, "", "x", "\0", "\x1b[2J", "../../etc/passwd", "x" * 70_000,
    [], [[]], [[0, 0, 0]] * 16, [[1e9, -1e9, 0.5]] * 16, {}, {"a": []}, {"model": "toy", "messages": []},
)  # fmt: skip
_ANSWER = ("text", "error", "detail", "waypoints", "rung", "status", "raw", "model")


def spoil_transcripts(folder: Path, seed: int) -> None:
    """Make the unpacked transcripts of a sound entry hostile in one way; the same for a seed."""
    rng = random.Random(seed)
    rng.choice(_WAYS)(folder, rng)


def _json(folder: Path, rng: random.Random) -> None:
    """A line that is hostile JSON."""
    file = _one(folder, rng)
    lines = file.read_bytes().splitlines()
    place = rng.randrange(len(lines))
    lines[place] = hostile_text(json.loads(lines[place]), rng).replace(b"\n", b" ")
    file.write_bytes(b"\n".join(lines) + b"\n")


def _value(folder: Path, rng: random.Random) -> None:
    """A suite that holds something else, with a key that fits."""

    def change(rows: Rows) -> None:
        row = rng.choice(rows)
        row[rng.choice(list(row))] = rng.choice(_VALUES)

    _rewrite(folder, rng, change)


def _swapped(folder: Path, rng: random.Random) -> None:
    """Attempts in each other's places: under another seed, with another's answer, in another order."""
    names = rng.choice([("seed",), ("attempt",), ("seed", "attempt"), ("request", *_ANSWER), ()])

    def change(rows: Rows) -> None:
        first, second = rng.sample(range(len(rows)), 2)
        if names and rng.random() < 0.8:  # of one round, where the first requests are alike
            first, second = rng.sample([k for k, row in enumerate(rows) if row["round"] == 0], 2)
        rows[first], rows[second] = rows[second], rows[first]
        for name in names:
            rows[first][name], rows[second][name] = rows[second][name], rows[first][name]

    _rewrite(folder, rng, change)


_WAYS = [_json, _value, _swapped]


def _rewrite(folder: Path, rng: random.Random, change: Callable[[Rows], None]) -> None:
    """Change the rows of a transcript; mostly with keys that fit, as a careful forger would."""
    file = _one(folder, rng)
    rows = rows_of(file)
    change(rows)
    for row in rows if rng.random() < 0.9 else ():
        try:
            row["key"] = Attempt.read(row, "here").key
        except (UserError, ValueError):
            continue
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))


def _one(folder: Path, rng: random.Random) -> Path:
    return rng.choice(sorted(folder.glob("*.jsonl")))


def _seeded(body):
    """The toy model, with a path for each seed."""
    text = toy(body)
    return text if "seed" not in body else text.replace('"z": 300', f'"z": {body["seed"] % 300}')


class Recorded:
    """Records a model in a folder.

    Attributes:
        entry: the honest entry's folder.
        suite: the suite that was played.
        honest: the records of the honest entry; see :meth:`flown`.
    """

    def __init__(self, folder):
        file = folder / "mine.yml"
        file.write_text(PLANNER_SUITE)
        profile = folder / "seeded.yml"
        profile.write_text("about: It answers each seed in another way.\nseed: true\n")
        record(folder, file, _seeded, server=str(profile))
        self.entry, self.suite = enter(folder / "out", folder / "entry", pack=False), load_suite(str(file))
        self.honest = self.flown(self.entry)
        assert self.honest is not None

    def flown(self, entry):
        """Return what must agree of an entry's records; None where it is refused in clear lines."""
        found = check_transcripts(entry, self.suite)
        assert all(line.isprintable() and len(line) < 1000 for line in found)
        if found:
            return None
        try:
            part = Part("toy", None, "transcripts", recorded=entry)
            lines = list(part_records(part, matchups_of([self.suite])))
        except (UserError, OSError):
            return None
        return [(line.rounds_sha256, line.returns, line.plans and line.plans.statuses) for line in lines]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return Recorded(tmp_path_factory.mktemp("recorded"))


@pytest.mark.parametrize("seed", range(SEED, SEED + 20 * SCALE))
def test_what_was_spoilt_is_named_or_changes_nothing(recorded, tmp_path, seed):
    folder = shutil.copytree(recorded.entry, tmp_path / "entry")
    spoil_transcripts(folder / "transcripts", seed)
    assert recorded.flown(folder) in (None, recorded.honest)
