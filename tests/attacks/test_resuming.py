"""A command that is killed, stopped or out of room at a write, and run again, ends as an undisturbed one."""

from __future__ import annotations

import contextlib
import errno
import gzip
import itertools
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fpg_bench.cli import main as cli
from fpg_bench.common import parallel
from fpg_bench.common.parallel import _attempt as attempt
from fpg_bench.common.rows import RowFile
from fpg_bench.products.leaderboard.season import closing
from fpg_bench.products.league import best_responses, double_oracle
from fpg_bench.products.papers.yang_2026 import study
from fpg_bench.products.papers.yang_2026.experiment import Budget
from tests.attacks import SCALE
from tests.attacks.test_command_lines import verbs
from tests.policies import write_seed
from tests.products.hub.conftest import hub
from tests.products.leaderboard.entering import enter
from tests.products.leaderboard.test_close_season import few_steps
from tests.training.tiny import ALLY, settings

__all__ = ["hub"]

QUICK = "--hyperparams tiny.yml --steps 400"
VERBS = {
    "evaluate": "evaluate expert idle --suite ally-v2 --matches 1 --out FOLDER",
    "planners": "evaluate hold hill-climb --suite planner-v1 --matches 1 --out FOLDER",
    "data set": "dataset make ally-random-v0 --steps 600 --out FOLDER",
    "reproduce": "reproduce yang-2026 fig4 --n-seeds 1 --n-jobs 1 --out FOLDER",
    "train": f"train ppo {ALLY} --seeds 0-1 {QUICK} --n-evals 1 --n-jobs 1 --out FOLDER",
    "train a team": f"train ppo FPG/team_v0 --side ally --seeds 0-1 {QUICK} --n-jobs 1 --out FOLDER",
    "best-response": f"best-response expert {QUICK} --n-seeds 1 --out FOLDER",
    "rule-search": "rule-search --side opponent --against idle --budget 0.01 --out FOLDER",
    "tabular-self-play": "tabular-self-play --iterations 2 --games 16 --out FOLDER",
    "double-oracle": f"double-oracle --iterations 2 --against tone --algorithm ppo {QUICK} "
    "--response-algorithm ppo --response-hyperparams tiny.yml --out FOLDER",
}
DEAR = {"train", "train a team", "best-response", "double-oracle", "reproduce"}  # seconds at each write
TUNE = f"tune run ppo {ALLY} --n-trials 3 --n-seeds 1 --rounds 3 {QUICK}"
# Of each verb with several workers, but for the closing of a season, whose jobs take minutes
WORKERS = {
    "train": f"train ppo {ALLY} --seeds 0-1 {QUICK} --n-evals 0 --n-jobs 2 --out FOLDER",
    "evaluate": "evaluate expert idle --suite ally-v2 --matches 1 --n-jobs 2 --out FOLDER",
    "dataset make": "dataset make ally-random-v0 --steps 600 --n-jobs 2 --out FOLDER",
    "offline": "offline bc ally-random-v0 --seeds 0-1 --steps 30 --n-evals 1 --n-jobs 2 --out FOLDER",
    "reproduce": "reproduce yang-2026 fig4 --n-seeds 2 --n-jobs 2 --out FOLDER",
    "tune run": f"{TUNE} --n-jobs 2 --out FOLDER",
    "tune export": "tune export FOLDER best.yml --n-best 2 --n-seeds 2 --force --n-jobs 2",
    "leaderboard verify": "leaderboard verify --update --folder FOLDER --n-jobs 2",
    "submit run": "submit run FOLDER/submissions/ally/pupil --n-jobs 2",
}
BEFORE = {"offline": "dataset make ally-random-v0 --steps 600", "tune export": f"{TUNE} --out begun"}
TINY = Budget("tiny", 8_000, 8, 25, 2, 1)
_TIMES = ("seconds", "spent", "steps_per_s")  # how long planning or training took
# What happens at a write, the status that the command ends with, and what its line says.
STOPPED = "stopped; what was finished is kept"
FAULTS = {
    "killed": (signal.SIGKILL, {-signal.SIGKILL}, ""),
    "full": (None, {1, 2}, "No space left on device"),
    "interrupted": (signal.SIGINT, {130}, STOPPED),
    "ended": (signal.SIGTERM, {143}, STOPPED),
}


def check(words: str, scratch: Path, begin: Callable[[Path], object] = lambda folder: None) -> None:
    """Disturb a command at its first, 16th, 256th ... write, run it again, and compare what it leaves.

    The faults take turns; with more time all come, and at each power of two.

    Args:
        words: the command; ``FOLDER`` stands for the folder that it fills.
        scratch: the folder of all these.
        begin: makes what the command finds in its folder; by default nothing.
    """

    def filled(name: str, fault: str = "", at: int | None = None) -> tuple[bool, dict[str, Any]]:
        """Return whether the first run ended well by itself, and what is there after the last."""
        folder = scratch / name / "made"
        folder.parent.mkdir()
        begin(folder)
        line = [word.replace("FOLDER", str(folder)) for word in words.split()]
        status, said = _run(line, fault, at)
        if status:
            _, expected, message = FAULTS.get(fault, (None, {0}, ""))
            assert status in expected, said
            assert "Traceback" not in said
            assert message in said
            assert said.count("fpg-bench: ") <= 1, said
            again, said = _run(line)  # a season that was just closed is refused
            assert again == 0, said
        return status == 0, contents(folder.parent)

    (is_whole, whole), at, in_turn = filled("whole"), 1, itertools.cycle(FAULTS)
    assert is_whole
    while not is_whole or at == 1:
        for fault in FAULTS if SCALE > 1 else [next(in_turn)]:
            is_whole, again = filled(f"{fault}-{at}", fault, at)
            assert again == whole, (fault, at)
        at *= 2 if SCALE > 1 else 16
    assert at > 2


def _run(words: list[str], fault: str = "", at: int | None = None) -> tuple[int, str]:
    """Run a command, with a fault at some write; returns its status and what it said."""
    with tempfile.NamedTemporaryFile("r") as said:
        how = (words, said.name, FAULTS[fault][0] if fault else None, at)
        process = multiprocessing.get_context("fork").Process(target=_verb, args=how)
        process.start()
        process.join()
        return process.exitcode, said.read()


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
    return [*map(_untimed, content)] if isinstance(content, list) else content


def _verb(words: list[str], said: str, number: int | None, at: int | None) -> None:
    sys.stdout = sys.stderr = Path(said).open("a", buffering=1)  # noqa: SIM115
    study.BUDGETS = {**study.BUDGETS, "quick": TINY}
    double_oracle.MATCHES = best_responses.MATCHES = best_responses.FINAL_MATCHES = 3
    numbers, replace, append = itertools.count(1), os.replace, RowFile.append

    def strike(path: Any) -> None:
        if number is None:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        os.kill(os.getpid(), number)

    def replace_or_not(*names: Any) -> None:
        if next(numbers) == at:
            strike(names[-1])
        replace(*names)

    def append_or_not(file: RowFile, rows: Iterable[dict[str, Any]]) -> None:
        is_struck = next(numbers) == at
        if not is_struck or number is not None:
            append(file, rows := list(rows))
        if is_struck and number == signal.SIGKILL:
            os.truncate(file.path, file.path.stat().st_size - 10)  # as if it was in the midst of a line
        if is_struck:
            strike(file.path)

    os.replace, RowFile.append = replace_or_not, append_or_not
    sys.argv = ["fpg-bench", *words]
    cli.main()


@pytest.mark.process
@pytest.mark.parametrize("verb", [pytest.param(v, marks=pytest.mark.full) if v in DEAR else v for v in VERBS])
def test_a_disturbed_command_resumes_to_the_same_result(verb, tmp_path, monkeypatch):
    _begin(tmp_path, monkeypatch)
    check(VERBS[verb], tmp_path)


def _begin(folder, monkeypatch):
    monkeypatch.chdir(folder)
    ids = (ALLY, "FPG/AllyVsPolicy-v0", "FPG/OpponentVsPolicy-v0", "FPG/team_v0")
    Path("tiny.yml").write_text(json.dumps(dict.fromkeys(ids, settings("ppo", normalize=False))))


def _attempt_or_die(run: Callable[[], Any], folder: str) -> Any:
    """Attempt a job; the first worker of all that has finished one is killed before it says so."""
    outcome = attempt(run, folder)
    with contextlib.suppress(FileExistsError):
        os.close(os.open(os.environ["DIED"], os.O_CREAT | os.O_EXCL))
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome


def _in_rows(found: dict[str, Any]) -> dict[str, Any]:
    """Return contents whose rows stand in the order in which several workers do not add them."""
    return {
        name: sorted(part, key=json.dumps) if isinstance(part, list) else part for name, part in found.items()
    }


@pytest.mark.full
@pytest.mark.process
@pytest.mark.parametrize("verb", WORKERS)
def test_a_killed_worker_loses_nothing(verb, tmp_path, monkeypatch, request):
    _begin(tmp_path, monkeypatch)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    if verb in BEFORE:
        assert _run(BEFORE[verb].split())[0] == 0
    elif verb in ("leaderboard verify", "submit run"):
        board, _ = map(request.getfixturevalue, ("board", "in_process"))
        enter(board, "ally", "pupil", seeds=(0, 1))
        enter(board, "opponent", "tone", script="tone")
        shutil.copytree(board, "begun")
    found = []
    for name in ("whole", "killed"):
        monkeypatch.setenv("DIED", str(tmp_path / f"{name}.flag"))
        monkeypatch.setattr(parallel, "_attempt", attempt if name == "whole" else _attempt_or_die)
        folder = tmp_path / name / "made"
        folder.parent.mkdir()
        if Path("begun").exists():
            shutil.copytree("begun", folder)
        status, said = _run(WORKERS[verb].replace("FOLDER", str(folder)).split())
        assert status == 0, said
        assert said.count("a worker process was lost (killed, or out of memory?)") == (name == "killed")
        assert "Traceback" not in said
        found.append(_in_rows(contents(folder.parent)))
    assert (tmp_path / "killed.flag").exists()
    assert found[0] == found[1]


def test_each_verb_that_has_workers_loses_one():
    several = {words for words, verb in verbs() if "--n-jobs" in (each.opts[0] for each in verb.params)}
    assert {" ".join(words) for words in several} == {"leaderboard close-season", *WORKERS}


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
