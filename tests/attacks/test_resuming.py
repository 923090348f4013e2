"""A command that is killed at a write and run again gives the same result as an uninterrupted one."""

from __future__ import annotations

import gzip
import itertools
import json
import multiprocessing
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fpg_bench.cli import main as cli
from fpg_bench.common.rows import RowFile
from fpg_bench.products.leaderboard.season import closing
from fpg_bench.products.papers.yang_2026 import study
from fpg_bench.products.papers.yang_2026.experiment import Budget
from tests.attacks import SCALE
from tests.policies import write_seed
from tests.products.hub.conftest import hub
from tests.products.leaderboard.entering import enter
from tests.products.leaderboard.test_close_season import few_steps

__all__ = ["hub"]

VERBS = {
    "evaluate": "evaluate expert idle --suite ally-v2 --matches 1 --out FOLDER",
    "planners": "evaluate hold hill-climb --suite planner-v1 --matches 1 --out FOLDER",
    "data set": "dataset make ally-random-v0 --steps 600 --out FOLDER",
    "reproduce": "reproduce yang-2026 fig4 --n-seeds 1 --n-jobs 1 --out FOLDER",
}
TINY = Budget("tiny", 8_000, 8, 25, 2, 1)
_TIMES = ("seconds", "steps_per_s")  # how long planning or training took


def check(words: str, scratch: Path, begin: Callable[[Path], object] = lambda folder: None) -> None:
    """Kill a command at its first, second, fourth ... write, run it again, and compare what is in its folder.

    Args:
        words: the command; ``FOLDER`` stands for the folder that it fills.
        scratch: the folder of all these.
        begin: makes what the command finds in its folder; by default nothing.
    """

    def filled(name: str, *kills: int | None) -> tuple[bool, dict[str, Any]]:
        """Return whether the first run ended well by itself, and what is there after the last."""
        folder = scratch / name
        begin(folder)
        ended = [_run([word.replace("FOLDER", str(folder)) for word in words.split()], at) for at in kills]
        return ended[0], contents(folder)

    before = set(os.listdir(scratch))
    (is_whole, whole), at, names = filled("whole", None), 1, {"whole"}
    assert is_whole
    while not is_whole or at == 1:
        name = f"killed-{at}"
        is_whole, again = filled(name, at, None)  # a season that was just closed is refused
        assert again == whole, name
        names.add(name)
        at *= 2
    assert at > 2
    assert set(os.listdir(scratch)) - before == names


def _run(words: list[str], dies_at: int | None) -> bool:
    """Run a command, to some write at most; returns whether it ended well by itself."""
    process = multiprocessing.get_context("fork").Process(target=_verb, args=(words, dies_at))
    process.start()
    process.join()
    return process.exitcode == 0


def contents(folder: Path) -> dict[str, Any]:
    """Return the JSON files of a folder without its name and times; of other files the name."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and "tfevents" not in path.name)
    return {str(path.relative_to(folder)): _content(path, folder) for path in files}


def _content(path: Path, folder: Path) -> Any:
    if path.suffix == ".gz":
        text = gzip.decompress(path.read_bytes()).decode()
    elif path.suffix in (".json", ".jsonl"):
        text = path.read_text().replace(str(folder), "FOLDER")
    else:
        return None
    if path.suffix == ".json":
        return _untimed(json.loads(text))
    return [_untimed(json.loads(record)) for record in text.splitlines()]


def _untimed(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _untimed(value) for key, value in content.items() if key not in _TIMES}
    return content


def _verb(words: list[str], dies_at: int | None) -> None:
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    study.BUDGETS = {**study.BUDGETS, "quick": TINY}
    numbers, replace, append = itertools.count(1), os.replace, RowFile.append

    def replace_or_die(*names: Any) -> None:
        if next(numbers) == dies_at:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*names)

    def append_or_die(file: RowFile, rows: Iterable[dict[str, Any]]) -> None:
        rows = list(rows)
        append(file, rows)
        if next(numbers) == dies_at:
            os.truncate(file.path, file.path.stat().st_size - 10)  # as if it was in the midst of a line
            os.kill(os.getpid(), signal.SIGKILL)

    os.replace, RowFile.append = replace_or_die, append_or_die
    sys.argv = ["fpg-bench", *words]
    cli.main()


@pytest.mark.process
@pytest.mark.parametrize("verb", VERBS)
def test_a_killed_command_resumes_to_the_same_result(verb, tmp_path):
    check(VERBS[verb], tmp_path)


@pytest.mark.process
def test_a_killed_verification_resumes_to_the_same_results(board, in_process, tmp_path):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "pupil", seeds=(0, 1))
    enter(board, "opponent", "tone", script="tone")
    (tmp_path / "boards").mkdir()
    words = "leaderboard verify --update --folder FOLDER"
    check(words, tmp_path / "boards", partial(shutil.copytree, board))


@pytest.mark.process
@pytest.mark.skipif(SCALE == 1, reason="its own tests leave it as a kill does")
def test_a_killed_closing_resumes_to_the_same_season(board, in_process, tmp_path, monkeypatch):
    for side, names in (("ally", ("expert", "idle")), ("opponent", ("tone", "sweep"))):
        for name in names:
            enter(board, side, name, script=name)
    monkeypatch.setattr(closing, "make_closing", partial(closing.make_closing, candidates=2, size=2))
    words = f"leaderboard close-season 1 --folder {board} --n-jobs 1"
    with few_steps(checks=()):
        check(f"{words} --work FOLDER/work --out FOLDER/season-1", tmp_path)


@pytest.mark.process
def test_a_killed_download_leaves_nothing_beside_the_agent(hub, tmp_path):
    write_seed(tmp_path / "first", 0, None)
    hub.add("me/mine", {path.name: path.read_bytes() for path in (tmp_path / "first").iterdir()})
    (tmp_path / "agents").mkdir()
    check("hub pull me/mine --out FOLDER", tmp_path / "agents")
