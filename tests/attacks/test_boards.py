"""One hostile pull request never stops the board for the others."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.products.leaderboard import cases, crossplay
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import crossplay_file, result_file
from fpg_bench.products.leaderboard.site.build import build_site
from fpg_bench.products.leaderboard.verification import verify
from tests.attacks import SCALE, SEED
from tests.attacks.json_texts import hostile_text, hostile_texts
from tests.logged import logged
from tests.products.leaderboard.entering import bad_pairs, enter, resealed
from tests.products.leaderboard.example_board import small_zoo
from tests.products.leaderboard.making import problems

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


def spoil(folder: Path, result: Path, seed: int) -> None:
    """Make a sound submission's folder, or its result's file, into a hostile one; the same for a seed."""
    rng = random.Random(seed)
    ways = (_text, _text, _key, _about, _model, _stray, _link, _swap, _result, _result, _edited)
    rng.choice(ways)(folder, result, rng)


def _text(folder: Path, result: Path, rng: random.Random) -> None:
    """A hostile value in the place of a field's."""
    file = folder / "submission.yaml"
    fields = yaml.safe_load(file.read_text())
    key, text = rng.choice(list(fields)), rng.choice(_TEXTS)
    lines = [f"{name}: {text if name == key else json.dumps(value)}" for name, value in fields.items()]
    file.write_bytes(("\n".join(lines) + "\n").encode("utf-8", "surrogatepass"))


def _key(folder: Path, result: Path, rng: random.Random) -> None:
    """A line more, or a file that is cut or broken."""
    file = folder / "submission.yaml"
    text = file.read_bytes()
    aliases = b"".join(b"%c: &%c [*%c,*%c,*%c,*%c]\n" % (k + 1, k + 1, k, k, k, k) for k in b"abcdefg")
    lines = [b"name: twice\n", b"\xff\xfe", b"? " + b"[" * 500, b"<<: {name: x}\n", b"\0"]
    lines += [b"x: &a [b]\ny: [*a, *a]\n", b"a: &a [x,x,x,x]\n" + aliases]
    place = rng.choice([0, len(text), rng.randrange(len(text))])
    is_cut = rng.random() < 0.2 and place
    file.write_bytes(text[:place] if is_cut else text[:place] + rng.choice(lines) + text[place:])


def _about(folder: Path, result: Path, rng: random.Random) -> None:
    """An ``agent.json`` that is hostile JSON."""
    file = _one(folder, "seed_*/agent.json", rng)
    file.write_bytes(hostile_text(json.loads(file.read_text()), rng))


def _model(folder: Path, result: Path, rng: random.Random) -> None:
    """A ``policy.onnx`` that is not what ``agent.json`` describes."""
    file = _one(folder, "seed_*/policy.onnx", rng)
    data = bytearray(file.read_bytes())
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    file.write_bytes(data[: rng.randrange(len(data))] if rng.random() < 0.3 else data)


def _stray(folder: Path, result: Path, rng: random.Random) -> None:
    """A name that does not belong there."""
    where = rng.choice([folder, folder, next(folder.glob("seed_*"))])
    raw = [b"\xff\xfe", b"\x1b[31m", "\u202egpj".encode(), *(name.encode() for name in _NAMES)]
    path = os.path.join(os.fsencode(where), rng.choice(raw))
    if not os.path.lexists(path):
        rng.choice([os.mkdir, lambda new: os.close(os.open(new, os.O_CREAT)), os.mkfifo])(path)
        return
    os.rename(path, path + b"~")


def _link(folder: Path, result: Path, rng: random.Random) -> None:
    """A link, a pipe or a folder in the place of a file."""
    file = rng.choice([folder / "submission.yaml", *folder.glob("seed_*/*")])
    file.unlink()
    ways: list[Callable[[], Any]] = [lambda: os.mkfifo(file), lambda: file.mkdir(), lambda: None]
    ways += [lambda: file.symlink_to("/dev/zero"), lambda: file.symlink_to(file)]
    rng.choice(ways)()


def _swap(folder: Path, result: Path, rng: random.Random) -> None:
    """Seeds that are one another, or not there."""
    first, second = sorted(folder.glob("seed_*"))[:2]
    if rng.random() < 0.5:
        for name in ("agent.json", "policy.onnx"):
            (second / name).write_bytes((first / name).read_bytes())
    else:
        second.rename(second.with_name(f"seed_{10 ** rng.randrange(1, 9)}"))


def _result(folder: Path, result: Path, rng: random.Random) -> None:
    """A result in whose head, or in one of whose lines, hostile JSON stands."""
    rows = result.read_bytes().splitlines()
    place = rng.randrange(len(rows))
    rows[place] = hostile_text(json.loads(rows[place]), rng).replace(b"\n", b" ")
    result.write_bytes(b"\n".join(rows) + b"\n")


def _edited(folder: Path, result: Path, rng: random.Random) -> None:
    """A result with a round that was made better by hand."""
    head, *lines = map(json.loads, result.read_text().splitlines())
    lines[0]["returns"][0] += 10
    result.write_text("".join(json.dumps(row, separators=(",", ":")) + "\n" for row in (head, *lines)))


def _one(folder: Path, pattern: str, rng: random.Random) -> Path:
    return rng.choice(sorted(folder.glob(pattern)))


pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_agents")]

COUNT = 16 * SCALE


@pytest.fixture(scope="module")
def few_agents():
    with small_zoo():
        yield


@pytest.fixture
def entered(board, in_process):
    """A board of honest entries, verified."""
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "linear", seeds=(0, 2))
    enter(board, "opponent", "near", script="adaptive")
    assert all(verdict.is_good for verdict in verify(board))
    return board


@pytest.fixture
def stormed(entered):
    """The same board with copies of an honest entry, each spoilt in another way."""
    for seed in range(COUNT):
        slug = f"hostile-{seed}"
        folder = shutil.copytree(entered / "submissions/ally/linear", entered / "submissions/ally" / slug)
        about = (folder / "submission.yaml").read_text()
        (folder / "submission.yaml").write_text(about.replace("Linear", slug))
        result = result_file(entered, "ally", slug)
        head, *lines = result_file(entered, "ally", "linear").read_text().splitlines(keepends=True)
        result.write_text("".join([json.dumps(json.loads(head) | {"slug": slug}) + "\n", *lines]))
        spoil(folder, result, SEED + seed)
    return entered


def test_hostile_entries_stop_nobody_else(stormed, tmp_path, messages, monkeypatch):
    monkeypatch.setattr(crossplay, "ROUNDS", 2)
    folders = [stormed / f"submissions/ally/hostile-{seed}" for seed in range(COUNT)]
    for line in (line for folder in folders for line in problems(folder)):
        assert "a bug" not in line
        line.encode()
    for folder in (folders[3], folders[12]):
        checked = CliRunner().invoke(app, ["submit", "check", str(folder)])
        assert checked.exit_code == 1 or "nothing is wrong" in checked.stdout
    verdicts = {verdict.name: verdict.is_good for verdict in verify(stormed)}
    assert len(verdicts) == COUNT + 3
    assert {name for name, good in verdicts.items() if good} == {"ally/wise", "ally/linear", "opponent/near"}
    assert bad_pairs(stormed) == {}
    board = make_board(load_entries(stormed))
    assert sorted(entry.slug for entry, _ in board.tracks[0].verified()) == ["linear", "wise"]
    build_site(board, tmp_path / "site", {})
    assert not [line for line in messages if "a bug" in line]
    assert all(line.isprintable() for line in messages)


def test_a_hostile_line_of_cross_play_is_left_out_alone(entered, tmp_path):
    bad_pairs(entered)
    file = crossplay_file(entered)
    (sound,) = (json.loads(line) for line in file.read_text().splitlines() if '"wise"' in line)
    forged = [sound | {"ally_rewards": [99.0, 99.0]}, sound | {"lost": "x"}, sound | {"ally": "linear"}]
    texts = [text.replace(b"\n", b" ") for _, text in hostile_texts(40, base=sound)]
    texts += [resealed(row).strip().encode() for row in forged]
    file.write_bytes(file.read_bytes() + b"\n".join(texts) + b"\n")
    with logged() as messages:
        board = make_board(load_entries(entered))
    assert any("crossplay.jsonl" in line and "left out" in line for line in messages)
    assert repr(board.crossplay).count("99.0") == 0
    build_site(board, tmp_path / "site", {})
    assert "crossplay.jsonl" in bad_pairs(entered)
    assert bad_pairs(entered, update=True) == {}
    assert len(file.read_bytes().splitlines()) == 2


def test_even_a_bug_of_ours_stops_nobody_else(entered, monkeypatch):
    admit = cases.admit

    def fails(folder, *how):
        if folder.name == "wise":
            raise KeyError("nobody thought of this")
        return admit(folder, *how)

    monkeypatch.setattr(cases, "admit", fails)
    lines = {verdict.name: verdict.line for verdict in verify(entered) if not verdict.is_good}
    assert lines.keys() == {"ally/wise"}
    assert lines["ally/wise"].startswith("KeyError: 'nobody thought of this', in ")
