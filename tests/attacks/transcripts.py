"""Hostile transcripts of a language model: each an honest one, spoilt in one way."""

from __future__ import annotations

import copy
import gzip
import json
import os
import random
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fpg_bench.planning.llm.transcript import Attempt
from tests.attacks.json_texts import hostile_text
from tests.leaderboard.recording import rows_of, write_chained

Rows = list[dict[str, Any]]
_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 2**31, 10**39, 1.5, 1e308, "", "x", "\0", "\x1b[2J", "../../etc/passwd", "x" * 70_000,
    [], [[]], [[0, 0, 0]] * 16, [[1e9, -1e9, 0.5]] * 16, {}, {"a": []}, {"model": "toy", "messages": []},
)  # fmt: skip
_ANSWER = (
    "text",
    "error",
    "detail",
    "waypoints",
    "rung",
    "status",
    "raw",
    "tokens_in",
    "tokens_out",
    "model",
)
_PROMPTS = (
    b"", b"[]", b"user: [", b"{" * 3000, b"a: &a [*a]\n", b"\xff", b"user: ${history.__class__}\n", b"\0",
    b"about: x\nuser: $history$history$history\nrow: $x\nrounds: {first: 1, best: 1, latest: 1}\n",
    b"about: x\nuser: ''\nrow: ''\nrounds: {first: 999999999999, best: 0, latest: 0}\n",
    b"!!python/object/apply:os.system [id]\n", b"? [a]\n: b\n",
)  # fmt: skip


def spoil_transcripts(folder: Path, seed: int) -> str:
    """Make the transcripts of a sound entry hostile in one way; the same for a seed.

    Args:
        folder: that of the transcripts, unpacked.
        seed: of the draw.

    Returns:
        What was done, in a word.
    """
    rng = random.Random(seed)
    way: Callable[[Path, random.Random], None] = rng.choice(_WAYS)
    way(folder, rng)
    return way.__name__.removeprefix("_")


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


def _lines(folder: Path, rng: random.Random) -> None:
    """Lines that are missing, there twice, or another's."""

    def change(rows: Rows) -> None:
        first, second = rng.sample(rows, 2)
        which = rng.randrange(4)
        if which == 0:
            rows.remove(first)
        elif which == 1:
            rows.append(copy.deepcopy(first))
        elif which == 2:
            names = ("seed", "match", "round", "attempt")
            for name in rng.sample(names, rng.randrange(1, 5)):
                first[name], second[name] = second[name], first[name]
        else:
            first["round"], first["seed"] = (
                first["round"] + rng.choice([1, 100]),
                first["seed"] + rng.randrange(2),
            )

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


def _extra(folder: Path, rng: random.Random) -> None:
    """Requests for more than the planner asks for: tools, several answers, another seed or schema."""
    fields: dict[str, Any] = {
        "tools": [{"type": "function", "function": {"name": "fly"}}], "extra_body": {"think": True}, "n": 8,
        "best_of": 8, "seed": rng.randrange(2**31), "temperature": rng.uniform(0, 2), "max_tokens": 10**6,
        "max_completion_tokens": 10**6, "response_format": {"type": "json_object"}, "stop": ["x"],
        "logit_bias": {"1": 1}, "stream": True, "model": "toy-large", "messages2": [],
    }  # fmt: skip
    names = rng.sample(list(fields), rng.randrange(1, 4))
    share = rng.choice([0.3, 1.0])

    def change(rows: Rows) -> None:
        asked = [row["request"] for row in rows if row["request"]]
        for request in [asked[0], *(each for each in asked[1:] if rng.random() < share)]:
            request.update({name: fields[name] for name in names})

    _rewrite(folder, rng, change)


def _asked(folder: Path, rng: random.Random) -> None:
    """A prompt that the game never wrote: other rewards, more words, or none."""

    def change(rows: Rows) -> None:
        request = rng.choice([row for row in rows if row["request"]])["request"]
        message = rng.choice(request["messages"])
        text = message["content"]
        place = rng.randrange(len(text) + 1)
        message["content"] = rng.choice(
            [
                text + " The ally flies to 500, 500, 100.",
                text[:place],
                text[:place] + "7" + text[place:],
                "",
                text * 40,
            ]
        )

    _rewrite(folder, rng, change)


def _answered(folder: Path, rng: random.Random) -> None:
    """An answer that is better than what was given, in one of the places where it stands."""
    path = [[rng.uniform(0, 900), rng.uniform(0, 900), rng.uniform(0, 300)] for _ in range(16)]
    text = json.dumps({"waypoints": [dict(zip("xyz", point, strict=True)) for point in path]})

    def change(rows: Rows) -> None:
        row = rng.choice(rows)
        which = rng.randrange(5)
        if which == 0:
            row["text"] = text
        elif which == 1:
            row["waypoints"], row["status"] = path, "ok"
        elif which == 2:
            row["raw"] = rng.choice(
                [None, "x" * 10_000, text, {"choices": [{"message": {"content": text}}]}, {}]
            )
        elif which == 3:
            row["text"], row["waypoints"], row["status"] = text, path, "ok"
        else:
            row["error"], row["text"] = rng.choice(["budget", "http", "refused", "ok"]), None

    _rewrite(folder, rng, change)


def _packed(folder: Path, rng: random.Random) -> None:
    """An archive that is torn, swollen, or none."""
    file = _one(folder, rng)
    data = gzip.compress(file.read_bytes(), 1)
    place = rng.randrange(len(data))
    ways: list[Callable[[], bytes]] = [
        lambda: data[:place],
        lambda: data[:place] + bytes([data[place] ^ 1 << rng.randrange(8)]) + data[place + 1 :],
        lambda: gzip.compress(b"[" * 40_000_000, 1),
        lambda: gzip.compress(b"\n" * 200_000, 1),
        lambda: data + data,
        lambda: data + gzip.compress(b"{}\n"),
        lambda: zlib.compress(file.read_bytes()),
        lambda: b"\x1f\x8b" + rng.randbytes(200),
        lambda: b"",
    ]
    file.with_name(file.name + ".gz").write_bytes(rng.choice(ways)())
    file.unlink()


def _about(folder: Path, rng: random.Random) -> None:
    """A ``planner.json`` that is hostile, or tells of something else."""
    file = folder / "planner.json"
    about = json.loads(file.read_text())
    if rng.random() < 0.5:
        file.write_bytes(hostile_text(about, rng))
        return
    about[rng.choice(list(about))] = rng.choice(_VALUES)
    file.write_text(json.dumps(about))


def _prompt(folder: Path, rng: random.Random) -> None:
    """A prompt that is another one, or no YAML."""
    file = folder / "prompt.yml"
    text = file.read_bytes()
    place = rng.randrange(len(text))
    file.write_bytes(rng.choice([*_PROMPTS, text[:place], text[:place] + b"$history " + text[place:]]))


def _strange(folder: Path, rng: random.Random) -> None:
    """A file that is a link, a pipe or a folder, or does not belong there."""
    file = rng.choice(
        [_one(folder, rng), folder / "prompt.yml", folder / "planner.json", folder / "more.jsonl"]
    )
    file.unlink(missing_ok=True)
    ways: list[Callable[[], Any]] = [
        lambda: file.symlink_to("/dev/zero"),
        lambda: file.symlink_to(file),
        lambda: os.mkfifo(file),
        lambda: file.mkdir(),
        lambda: file.write_bytes(b"\0" * 1000),
    ]
    rng.choice(ways)()


_WAYS = [
    _json,
    *[_value] * 3,
    _lines,
    *[_swapped] * 2,
    *[_extra] * 2,
    *[_asked] * 2,
    *[_answered] * 2,
    _packed,
    _about,
    _prompt,
    _strange,
]


def _rewrite(folder: Path, rng: random.Random, change: Callable[[Rows], None]) -> None:
    """Change the rows of a transcript; mostly with keys that fit, as a careful forger would."""
    file = _one(folder, rng)
    rows = rows_of(file)
    change(rows)
    for row in rows if rng.random() < 0.9 else ():
        try:
            row["key"] = Attempt.read(row, "here").key
        except ValueError:
            continue
    if rng.random() < 0.9:
        write_chained(file, rows)
    else:
        file.write_text("".join(json.dumps(row) + "\n" for row in rows))


def _one(folder: Path, rng: random.Random) -> Path:
    return rng.choice(sorted(folder.glob("*.jsonl")))
