"""A command that is killed and run again gives the same result as an uninterrupted one."""

from __future__ import annotations

import gzip
import json
import math
import multiprocessing
import os
import random
import shutil
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fpg_bench.cli import main as cli
from fpg_bench.common.ids import policy_env
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.season import candidates, recipes
from fpg_bench.products.papers.yang_2026 import study
from fpg_bench.products.papers.yang_2026.experiment import Budget
from fpg_bench.training import callbacks
from tests.attacks import SCALE, SEED
from tests.policies import write_seed
from tests.products.hub.conftest import hub
from tests.products.leaderboard.entering import enter
from tests.training.tiny import settings

__all__ = ["hub"]

VERBS = {
    "evaluate": "evaluate expert idle --suite ally-v2 --matches 2 --out FOLDER",
    "compare": "plan compare hold hill-climb --suite planner-v1 --matches 2 --out FOLDER",
    "reproduce": "reproduce yang-2026 fig4 --n-seeds 1 --n-jobs 1 --out FOLDER",
}
TINY = Budget("tiny", 8_000, 8, 25, 2, 1)
_MOST_KILLS = 3
_TIMES = ("seconds", "steps_per_s")  # how long planning or training took


class Killed:
    """A command that was run to its end once, to be killed as often as one likes.

    Args:
        words: the command; ``FOLDER`` stands for the folder that it fills.
        folder: the folder of the run to the end.
        begin: makes what the command finds in a folder; by default nothing.
    """

    def __init__(
        self, words: str, folder: Path, begin: Callable[[Path], object] = lambda folder: None
    ) -> None:
        self._words, self._begin = words.split(), begin
        begin(folder)
        start = time.perf_counter()
        assert self._run(folder, None)
        self._seconds = time.perf_counter() - start
        self._uninterrupted = contents(folder)

    def same(self, folder: Path, seed: int) -> bool:
        """Return True if a run that is killed up to three times comes to what the uninterrupted one did."""
        rng = random.Random(seed)
        self._begin(folder)
        for _ in range(rng.randrange(1, _MOST_KILLS + 1)):
            self._run(folder, rng.uniform(0, self._seconds))
        self._run(folder, None)  # a season that was just closed is refused
        return contents(folder) == self._uninterrupted

    def _run(self, folder: Path, moment_s: float | None) -> bool:
        """Run the verb, for so many seconds at most; whether it ended well by itself."""
        process = multiprocessing.get_context("fork").Process(
            target=_verb, args=([word.replace("FOLDER", str(folder)) for word in self._words],)
        )
        process.start()
        process.join(moment_s)
        process.kill()
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


def _verb(words: list[str]) -> None:
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    study.BUDGETS = {**study.BUDGETS, "quick": TINY}
    callbacks.SAVE_EVERY_S = math.inf  # a run that goes on from a step on its way plays other matches
    sys.argv = ["fpg-bench", *words]
    cli.main()


@pytest.mark.process
@pytest.mark.parametrize("verb", ["compare"] if SCALE == 1 else VERBS)  # the others' own tests interrupt them
def test_a_killed_command_resumes_to_the_same_result(verb, tmp_path):
    values = settings("ppo", normalize={"norm_obs": False})
    (tmp_path / "tiny.yml").write_text(json.dumps({policy_env(side).id: values for side in SIDES}))
    check(Killed(VERBS[verb].format(scratch=tmp_path), tmp_path / verb), tmp_path)


def check(killed, scratch):
    """Kill a command from as many seeds as are tried; nothing but its folders is left."""
    before = set(os.listdir(scratch))
    for seed in range(SEED, SEED + SCALE):
        assert killed.same(scratch / f"killed-{seed}", seed=seed)
    assert set(os.listdir(scratch)) - before == {f"killed-{seed}" for seed in range(SEED, SEED + SCALE)}


@pytest.mark.process
def test_a_killed_verification_resumes_to_the_same_results(board, in_process, tmp_path):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "pupil", seeds=(0, 1))
    enter(board, "opponent", "tone", script="tone")
    words = "leaderboard verify --update --folder FOLDER"
    check(Killed(words, tmp_path / "whole", partial(shutil.copytree, board)), tmp_path)


@pytest.mark.process
@pytest.mark.skipif(SCALE == 1, reason="its own tests leave it as a kill does")
def test_a_killed_closing_resumes_to_the_same_season(board, in_process, tmp_path, monkeypatch):
    for side, names in (("ally", ("expert", "idle")), ("opponent", ("tone", "sweep"))):
        for name in names:
            enter(board, side, name, script=name)
    steps = {name: tuple(n // 2000 for n in each) for name, each in recipes.STEPS.items()}
    monkeypatch.setattr(recipes, "STEPS", steps)
    monkeypatch.setattr(candidates, "ROUNDS", 2)
    words = f"leaderboard close-season 1 --folder {board} --n-candidates 2 --size 2 --n-jobs 1"
    check(Killed(f"{words} --work FOLDER/work --out FOLDER/season-1", tmp_path / "whole"), tmp_path)


@pytest.mark.process
def test_a_killed_download_leaves_nothing_beside_the_agent(hub, tmp_path):
    write_seed(tmp_path / "first", 0, None)
    hub.add("me/mine", {path.name: path.read_bytes() for path in (tmp_path / "first").iterdir()})
    (tmp_path / "agents").mkdir()
    check(Killed("hub pull me/mine --out FOLDER", tmp_path / "whole"), tmp_path / "agents")
