"""One run of each verb with a tiny budget: the numbers that it writes are those of ``golden/verbs.json``.

The file holds numbers and hashes only, no names, so a renamed key or option changes a command line here and
nothing else. Each number list comes from one record, row or line of an output and has to be contained in one
of the current output, in the same order; additional numbers are allowed. What torch has computed differs
between processors and is left out: ``python -m tests.test_golden_verbs [NAME ...]`` rewrites it from two
runs that differ in their training, and keeps what both have in common.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.programs import fpg

pytestmark = [pytest.mark.full, pytest.mark.process, pytest.mark.slow]

ROOT = Path(__file__).parents[1]
GOLDEN = Path(__file__).parent / "golden" / "verbs.json"
STEPS, OTHER_STEPS = 400, 10_000  # of training; a number that both give does not come from torch
MOST_VALUES = 40  # of a group; of more, evenly spaced ones are kept
HYPERPARAMETERS = (
    "{policy: MlpPolicy, n_envs: 4, n_timesteps: 800, n_steps: 100, batch_size: 100, n_epochs: 1}"
)
IDS = [f"FPG/{side}Vs{other}-v0" for side in ("Ally", "Opponent") for other in ("Scripted", "Policy")]
ENTRIES = [f"{track}/{name}" for track, name in (("ally", "idle"), ("ally", "expert"), ("opponent", "tone"))]

SURROUNDINGS = {"MPLBACKEND": "module://nowhere.backend_inline", "LC_ALL": "C", "TERM": "dumb"}


@dataclass(frozen=True)
class Case:
    """A command line.

    Attributes:
        words: the verb and its options; ``@steps`` stands for a training budget.
        outputs: patterns of the files to read, one file each; ``-``: what is printed.
        kept: groups of numbers to keep at most.
    """

    words: str
    outputs: tuple[str, ...] = ("-",)
    kept: int = 30


# In this order in one folder: some use what others have written.
CASES = {
    "envs": Case("envs"),
    "players": Case("players"),
    "suites": Case("suites"),
    "scenario": Case("scenario show link --pays", kept=60),
    "zoo": Case("zoo --all", kept=150),
    "play": Case("play --ally expert-spread --opponent sweep --path circle --seed 4 --every 20"),
    "play-page": Case("play --scenario paper --seed 3 --out round.html", ("round.html",)),
    "evaluate": Case("evaluate idle expert --suite ally-v2 --matches 2 --out results", ("results/*.jsonl",)),
    "evaluate-opponent": Case(
        "evaluate tone --suite opponent-v2 --matches 1 --out opponents", ("opponents/*.jsonl",)
    ),
    "table": Case("table results --wide", ("-", "results/*.csv")),
    "play-planned": Case(
        "play --planner hill-climb --ally reactive --rounds 2 --seed 5 --out match.html", ("match.html",)
    ),
    "evaluate-planners": Case(
        "evaluate circle pursuit --suite planner-v1 --matches 1 --out comparison",
        ("comparison/*.jsonl", "comparison/*.csv"),
    ),
    "dataset-list": Case("dataset list"),
    "dataset-make": Case(
        "dataset make ally-random-v0 --steps 600 --out datasets", ("datasets/fpg/*/data/metadata.json",)
    ),
    "dataset-check": Case("dataset check datasets"),
    "offline": Case(
        "offline bc datasets/fpg/ally-random-v0 --steps @steps --n-evals 0 --out cloned",
        ("cloned/run.json", "cloned/agent/agent.json"),
    ),
    "train": Case(
        "train ppo FPG/AllyVsScripted-v0 --hyperparams tiny.yml --steps @steps --n-evals 0 --out run",
        ("run/run.json", "run/agent/agent.json"),
    ),
    "export": Case("export shipped --out mine/seed_0", ("mine/seed_0/agent.json", "-")),
    "tune": Case(
        "tune run ppo FPG/AllyVsScripted-v0 --n-trials 1 --n-seeds 1 --steps @steps --rounds 1 --out study",
        ("study/*.db",),
    ),
    "tune-export": Case("tune export study best.yml --n-best 1 --n-seeds 1 --steps @steps", ("best.yml",)),
    "best-response": Case(
        "best-response idle --steps @steps --n-seeds 1 --hyperparams tiny.yml --out exploited",
        ("exploited/*.json",),
    ),
    "submit-check": Case("submit check board/submissions/ally/idle"),
    "submit-run": Case("submit run board/submissions/opponent/tone", ("board/results/opponent/tone.jsonl",)),
    "leaderboard-verify": Case(
        "leaderboard verify ally/idle --folder board --sample 1% --sample-seed 3",
        ("board/results/crossplay.jsonl",),
    ),
    "leaderboard-build": Case(
        "leaderboard build --folder board --no-replays --out site", ("site/board.json", "site/ranking.html")
    ),
    "leaderboard-season": Case("leaderboard season season-4", kept=60),
    "reproduce": Case(
        "reproduce yang-2026 fig7 --scenario figures --budget hundredth --n-seeds 10 --first-seed 100"
        " --out reproduced",
        ("reproduced/report-figures.md", "reproduced/levels-figures.csv"),
        kept=120,
    ),
}


def prepare(folder: Path) -> None:
    """Lay out what the commands read: hyper-parameters, a shipped agent, a small board, finished runs."""
    (folder / "tiny.yml").write_text("".join(f"{name}: {HYPERPARAMETERS}\n" for name in IDS))
    shutil.copytree(ROOT / "baselines/agents/ally-scripted/ppo/seed_0", folder / "shipped")
    for entry in ENTRIES:
        shutil.copytree(ROOT / "leaderboard/submissions" / entry, folder / "board/submissions" / entry)
        result = folder / "board/results" / f"{entry}.jsonl"
        result.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / "leaderboard/results" / f"{entry}.jsonl", result)
    (folder / "reproduced").mkdir()
    shutil.copy(ROOT / "results/reproduction/figures-hundredth.jsonl.gz", folder / "reproduced")
    for path in filter(Path.is_file, folder.rglob("*")):
        path.chmod(0o600)


def run(case: Case, folder: Path, steps: int = STEPS) -> list[list[float | str]]:
    """Run a command in odd surroundings and return the groups of numbers in its outputs."""
    words = case.words.replace("@steps", str(steps)).split()
    finished = fpg(*words, folder=folder, environment=os.environ | SURROUNDINGS, umask=0o077)
    assert finished.returncode == 0, finished.stderr
    groups: list[list[float | str]] = []
    for pattern in case.outputs:
        if pattern == "-":
            texts = finished.stdout.splitlines()
        else:
            (path,) = folder.glob(pattern)
            assert not path.stat().st_mode & 0o077, path
            texts = list(groups_of(path))
        groups += [values for text in texts if (values := numbers(text))]
    return groups


def groups_of(path: Path) -> Iterator[Any]:
    """Return the parts of a file: records, rows, lines, or all of it."""
    if path.suffix == ".db":
        with contextlib.closing(sqlite3.connect(path)) as database:
            yield from database.execute("SELECT param_value, distribution_json FROM trial_params")
        return
    text = path.read_text()
    if path.suffix == ".jsonl":
        yield from map(json.loads, text.splitlines())
    elif path.suffix == ".json":
        yield json.loads(text)
    elif path.suffix == ".yml":
        yield yaml.safe_load(text)
    elif path.suffix == ".csv":
        yield from map(" ".join, list(csv.reader(text.splitlines()))[1:])
    elif path.suffix == ".html":
        yield from (part for part in re.split(r"<script|</tr>", text) if len(part) < 10**6)
    else:
        yield from text.splitlines()


def numbers(value: Any) -> list[float | str]:
    """Numbers with a fraction, whole ones from 100 on and hashes, sorted and each once."""
    return sorted(set(_numbers(value)), key=lambda item: (isinstance(item, str), item))


def _numbers(value: Any) -> Iterator[float | str]:
    if isinstance(value, dict):
        for each in value.values():
            yield from _numbers(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _numbers(each)
    elif isinstance(value, str):
        value = re.sub(r"\d{4}-\d\d-\d\d", "", value)  # a date
        yield from re.findall(r"\b[0-9a-f]{64}\b", value)
        for text in re.findall(r"(?<![\w.])-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?(?![\w.]*\d)", value):
            yield from _numbers(float(text.replace(",", "")))
    elif not isinstance(value, bool | None) and (value % 1 or 100 <= abs(value) < 1e9):
        yield float(f"{value:.9g}")


def missing(expected: Iterable[list[float | str]], groups: Iterable[list[float | str]]) -> list[Any] | None:
    """The first expected group that no later group of the output contains; None if all are contained."""
    rest = iter(groups)
    for values in expected:
        if not any(set(values) <= set(group) for group in rest):
            return values
    return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden")
    prepare(folder)
    return folder


@pytest.mark.parametrize("name", CASES)
def test_numbers_of_each_verb(name: str, folder: Path) -> None:
    golden = json.loads(GOLDEN.read_text())
    assert name in golden, f"make its numbers: python -m tests.test_golden_verbs {name}"
    assert missing(golden[name], run(CASES[name], folder)) is None


def write_golden(names: list[str]) -> None:
    """Rewrite the numbers of some cases, or of all, from two runs of each."""
    golden = json.loads(GOLDEN.read_text()) if names else {}
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        prepare(Path(first))
        prepare(Path(second))
        for name in names or CASES:
            case = CASES[name]
            once, twice = run(case, Path(first)), run(case, Path(second), OTHER_STEPS)
            both = {STEPS, *(value for group in twice for value in group)}
            common = [[value for value in group if value in both] for group in once]
            golden[name] = spaced([spaced(group, MOST_VALUES) for group in common if group], case.kept)
    lines = [
        f'"{name}": [' + ",\n  ".join(["", *map(json.dumps, groups)])[1:] + "]"
        for name, groups in golden.items()
    ]
    GOLDEN.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def spaced(items: list[Any], most: int) -> list[Any]:
    """At most so many items, evenly spaced."""
    return (
        items
        if len(items) <= most
        else [items[round(k * (len(items) - 1) / (most - 1))] for k in range(most)]
    )


if __name__ == "__main__":
    write_golden(sys.argv[1:])
