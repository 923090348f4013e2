"""Hostile pull requests: folders, texts and results as somebody may send them, beside honest ones."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from tests.attacks.json_texts import hostile_text

# What is written into the place of a text of submission.yaml, as YAML; the reader is YAML's own.
_TEXTS = (
    '"\\ud800"', '"\\0"', '"\\x1b[2J\\x1b]0;owned\\a"', '"a\\u202eb"', '"\\u200b"', '"\\u3164"', '" "',
    "''", "!!python/object/apply:os.system ['true']", "!!binary |\n    /////w==", "!!timestamp 9999-99-99",
    "2026-11-22", "&a [*a]", "*nowhere", "[" * 3000, "{" * 3000, "1" * 5000, "1" + ":59" * 20_000,
    "0x" + "f" * 5000, ".inf", "null", "true", "[]", "{}", "1e999", "-1", "'" + "x" * 70_000 + "'",
    "? [a]\n  : b", "<script>", "'{{7*7}}'", "!!set {a, b}", "!!omap [a: 1]", "!!float x", "1_0_0__0", "@",
    "`", "%", "\t", "- - - -", "'\\'", '"\\q"',
)  # fmt: skip
_NAMES = (
    "con", "a" * 255, "-rf", "seed_00", "seed_1e3", "seed_-1", "SEED_0", "policy.onnx", ".git",
    "a\nb",
)  # fmt: skip


def spoil(folder: Path, result: Path | None, seed: int) -> str:
    """Make a sound submission's folder, or its result, into a hostile one; the same for a seed.

    Args:
        folder: the submission's.
        result: its result's file; None: it has none.
        seed: of the draw.

    Returns:
        What was done, in a word.
    """
    rng = random.Random(seed)
    ways = [_text, _text, _key, _about, _model, _stray, _link, _swap]
    ways += [] if result is None else [_result, _result, _edited]
    way: Callable[[Path, Path | None, random.Random], None] = rng.choice(ways)
    way(folder, result, rng)
    return way.__name__.removeprefix("_")


def _text(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A hostile value in the place of a field's."""
    file = folder / "submission.yaml"
    fields = yaml.safe_load(file.read_text())
    key, text = rng.choice(list(fields)), rng.choice(_TEXTS)
    lines = [f"{name}: {text if name == key else json.dumps(value)}" for name, value in fields.items()]
    file.write_bytes(("\n".join(lines) + "\n").encode("utf-8", "surrogatepass"))


def _key(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A line more, or a file that is cut or broken."""
    file = folder / "submission.yaml"
    text = file.read_bytes()
    aliases = b"".join(b"%c: &%c [*%c,*%c,*%c,*%c]\n" % (k + 1, k + 1, k, k, k, k) for k in b"abcdefg")
    lines = [b"name: twice\n", b"\xff\xfe", b"? " + b"[" * 500, b"<<: {name: x}\n", b"\0"]
    lines += [b"x: &a [b]\ny: [*a, *a]\n", b"a: &a [x,x,x,x]\n" + aliases]
    place = rng.choice([0, len(text), rng.randrange(len(text))])
    is_cut = rng.random() < 0.2 and place
    file.write_bytes(text[:place] if is_cut else text[:place] + rng.choice(lines) + text[place:])


def _about(folder: Path, result: Path | None, rng: random.Random) -> None:
    """An ``agent.json`` that is hostile JSON."""
    file = _one(folder, "seed_*/agent.json", rng)
    file.write_bytes(hostile_text(json.loads(file.read_text()), rng))


def _model(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A ``policy.onnx`` that is not what ``agent.json`` describes."""
    file = _one(folder, "seed_*/policy.onnx", rng)
    data = bytearray(file.read_bytes())
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    file.write_bytes(data[: rng.randrange(len(data))] if rng.random() < 0.3 else data)


def _stray(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A name that does not belong there."""
    where = rng.choice([folder, folder, next(folder.glob("seed_*"))])
    raw = [b"\xff\xfe", b"\x1b[31m", "\u202egpj".encode(), *(name.encode() for name in _NAMES)]
    path = os.path.join(os.fsencode(where), rng.choice(raw))
    if not os.path.lexists(path):
        rng.choice([os.mkdir, lambda new: os.close(os.open(new, os.O_CREAT)), os.mkfifo])(path)
        return
    os.rename(path, path + b"~")


def _link(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A link, a pipe or a folder in the place of a file."""
    file = rng.choice([folder / "submission.yaml", *folder.glob("seed_*/*")])
    file.unlink()
    way: Callable[[], Any] = rng.choice(
        [
            lambda: file.symlink_to("/dev/zero"),
            lambda: file.symlink_to("/proc/self/environ"),
            lambda: file.symlink_to(file),
            lambda: os.mkfifo(file),
            lambda: file.mkdir(),
            lambda: None,
        ]
    )
    way()


def _swap(folder: Path, result: Path | None, rng: random.Random) -> None:
    """Seeds that are one another, or not there."""
    first, second = sorted(folder.glob("seed_*"))[:2]
    if rng.random() < 0.5:
        for name in ("agent.json", "policy.onnx"):
            (second / name).write_bytes((first / name).read_bytes())
    else:
        second.rename(second.with_name(f"seed_{10 ** rng.randrange(1, 9)}"))


def _result(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A result in whose head, or in one of whose lines, hostile JSON stands."""
    assert result is not None
    rows = result.read_bytes().splitlines()
    place = rng.randrange(len(rows))
    rows[place] = hostile_text(json.loads(rows[place]), rng).replace(b"\n", b" ")
    result.write_bytes(b"\n".join(rows) + b"\n")


def _edited(folder: Path, result: Path | None, rng: random.Random) -> None:
    """A result whose score was made better by hand."""
    assert result is not None
    head, *lines = map(json.loads, result.read_text().splitlines())
    head["summary"]["scores"]["public"]["value"] += 10
    result.write_text("".join(json.dumps(row, separators=(",", ":")) + "\n" for row in (head, *lines)))


def _one(folder: Path, pattern: str, rng: random.Random) -> Path:
    return rng.choice(sorted(folder.glob(pattern)))
