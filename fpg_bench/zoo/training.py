"""Training the zoo: every missing agent in a process of its own, then shipped and scored.

Where this process is killed outright, the trainings under way go on by themselves; the next call refuses to
train these beside them, and ships them once they are done.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from fpg_bench.checks import whole
from fpg_bench.errors import UserError
from fpg_bench.files import read_json, write_whole
from fpg_bench.ids import DUEL, sides_of
from fpg_bench.players.agent import load_agent
from fpg_bench.rows import RowFile
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.zoo.curves import keep_curve
from fpg_bench.zoo.scores import add_missing_lines
from fpg_bench.zoo.zoo import Zoo, ZooAgent

_LOCK = "zoo.lock"
_PAUSE_S = 0.5
_PROGRAM = (sys.executable, "-m", "fpg_bench.cli")


@dataclass(frozen=True)
class _Training:
    """A member under training: its process, when it began, and what it prints to."""

    member: ZooAgent
    process: subprocess.Popen[bytes]
    start_s: float
    log: IO[bytes]


def train_zoo(
    zoo: Zoo,
    runs: Path,
    *,
    only: str | None = None,
    jobs: int = 2,
    say: Callable[[str], None] = print,
) -> list[str]:
    """Train every agent that is missing, ship it and score it; what was stopped goes on.

    Args:
        zoo: what is to be trained, and where agents and scores go.
        runs: the folder of the runs' folders, ``<view>/<algorithm>/seed_<k>``.
        only: ``view``, ``view/algorithm`` or ``view/algorithm/seed_k``; None: all.
        jobs: how many are trained at once, one thread each.
        say: told a line per run that begins or ends.

    Returns:
        The names of those whose training failed; the others are not held up by them.

    Raises:
        UserError: nothing is called as ``only`` says, or another process trains into ``runs``.
        KeyboardInterrupt: stopped by the user; the trainings have saved where they were.
    """
    whole(jobs, "jobs")
    waiting = [member for member in zoo.members(only) if not member.shipped]
    failed: list[str] = []
    with RowFile(runs / _LOCK).locked(), _stopped_together() as running:
        while waiting or running:
            while len(running) < jobs and (member := _next(waiting, running, runs)):
                running.append(_start(member, runs))
                say(f"{running[-1].member.name}: training, see {running[-1].log.name}")
            for training in [t for t in running if t.process.poll() is not None]:
                running.remove(training)
                if not _finish(training, zoo, runs, say):
                    failed.append(training.member.name)
            time.sleep(_PAUSE_S)
    return failed


def run_folder(member: ZooAgent, runs: Path) -> Path:
    """Where a member is trained; both sides of a duel in one run."""
    view = member.view
    name = view.name.replace(f"-{view.side}", "") if view.id == DUEL else view.name
    return runs / name / member.algorithm / f"seed_{member.seed}"


def command(member: ZooAgent, runs: Path) -> list[str]:
    """The words behind ``fpg-bench`` that train a member, or go on with it."""
    view = member.view
    words = ["train", member.algorithm, view.id, "--seed", str(member.seed), "--steps", str(member.steps)]
    for name, value in view.options.items():
        listed = ",".join(map(str, value)) if isinstance(value, list) else str(value)
        words += [f"--{name.replace('_', '-')}", listed]
    measured = [] if view.id == DUEL else ["--field", view.fields[0]]
    return [*words, *measured, "--resume", "--out", str(run_folder(member, runs))]


def ship(member: ZooAgent, run: Path) -> None:
    """Copy a finished run's agent to its place in the zoo, ``agent.json`` last.

    Raises:
        UserError: the agent is not whole, or of another budget or seed than the zoo's.
    """
    agent = RunFolder(run).agent_of(member.view.side, sides_of(member.view.id))
    about = load_agent(agent).about
    wanted = {"id": member.view.id, "training_steps": member.steps, "training_seed": member.seed}
    for key, value in wanted.items():
        if about[key] != value:
            raise UserError(f"run {run}: {key} is {about[key]!r}, the zoo asks for {value!r}; remove it")
    for name in ("policy.onnx", "agent.json"):
        write_whole(member.folder / name, (agent / name).read_bytes())


def state(member: ZooAgent, runs: Path) -> str:
    """How far a member is: shipped, trained, begun, or missing."""
    if member.shipped:
        return "shipped"
    file = run_folder(member, runs) / "run.json"
    if not file.is_file():
        return "missing"
    return "trained" if read_json(file, "run").get("finished") else "begun"


def _next(waiting: list[ZooAgent], running: list[_Training], runs: Path) -> ZooAgent | None:
    """Take the first that is not trained in a run that is under way."""
    busy = {run_folder(training.member, runs) for training in running}
    free = next((member for member in waiting if run_folder(member, runs) not in busy), None)
    if free is not None:
        waiting.remove(free)
    return free


def _start(member: ZooAgent, runs: Path) -> _Training:
    folder = run_folder(member, runs)
    folder.parent.mkdir(parents=True, exist_ok=True)
    log = _log(folder).open("ab")
    words = [*_PROGRAM, *command(member, runs)]
    # A group of its own: Ctrl-C comes to it once, from here, and not from the terminal as well.
    process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, process_group=0)
    return _Training(member, process, time.monotonic(), log)


def _log(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.log")


def _finish(training: _Training, zoo: Zoo, runs: Path, say: Callable[[str], None]) -> bool:
    """Ship and score what was trained; whether that went well."""
    training.log.close()
    member, folder = training.member, run_folder(training.member, runs)
    try:
        if training.process.returncode:
            raise UserError(f"{_last_line(_log(folder))} (see {_log(folder)})")
        keep_curve(zoo, member, folder)
        ship(member, folder)
        add_missing_lines(zoo, member.view)
    except UserError as error:
        say(f"{member.name}: failed: {error}")
        return False
    say(f"{member.name}: shipped after {(time.monotonic() - training.start_s) / 60:.1f} min")
    return True


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")


@contextlib.contextmanager
def _stopped_together() -> Iterator[list[_Training]]:
    """A list of trainings, which are stopped and waited for when the block is left early."""
    running: list[_Training] = []
    try:
        yield running
    finally:
        for training in running:
            training.process.send_signal(signal.SIGINT)
        for training in running:
            training.process.wait()
            training.log.close()
