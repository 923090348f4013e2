"""Training the zoo: every missing agent, then shipped and scored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from fpg_bench.checks import whole
from fpg_bench.errors import UserError
from fpg_bench.files import write_whole
from fpg_bench.ids import DUEL, sides_of
from fpg_bench.jobs.job import Job
from fpg_bench.jobs.run import run_jobs
from fpg_bench.players.agent import load_agent
from fpg_bench.rows import RowFile
from fpg_bench.training.config import GameOptions, RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train
from fpg_bench.zoo.curves import keep_curve
from fpg_bench.zoo.scores import add_missing_lines
from fpg_bench.zoo.zoo import Zoo, ZooAgent

_LOCK = "zoo.lock"


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
        The names of those that are still missing, as something failed; the others are not held up by them.

    Raises:
        UserError: nothing is called as ``only`` says, or another process trains into ``runs``.
        KeyboardInterrupt: stopped by the user; the trainings have saved where they were.
    """
    whole(jobs, "jobs")
    missing = [member for member in zoo.members(only) if not member.shipped]
    by_run: dict[Path, list[ZooAgent]] = {}
    for member in missing:
        by_run.setdefault(run_folder(member, runs).absolute(), []).append(member)
    listed = [
        Job(
            members[0].name,
            partial(train, run_spec(members[0]), folder, progress=False, resume=True),
            partial(_take, zoo, members, folder, say),
        )
        for folder, members in by_run.items()
    ]
    with RowFile(runs / _LOCK).locked():
        run_jobs(listed, jobs, say=say)
    return [member.name for member in missing if not member.shipped]


def run_folder(member: ZooAgent, runs: Path) -> Path:
    """Where a member is trained; both sides of a duel in one run."""
    view = member.view
    name = view.name.replace(f"-{view.side}", "") if view.id == DUEL else view.name
    return runs / name / member.algorithm / f"seed_{member.seed}"


def run_spec(member: ZooAgent) -> RunConfig:
    """The run that trains a member."""
    view = member.view
    field = None if view.id == DUEL else view.fields[0]
    game = GameOptions(**view.options)
    return RunConfig(member.algorithm, view.id, member.seed, member.steps, game=game, field=field)


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
    folder = RunFolder(run_folder(member, runs))
    if folder.is_finished():
        return "trained"
    return "begun" if (folder.path / "run.json").is_file() else "missing"


def _take(zoo: Zoo, members: Sequence[ZooAgent], run: Path, say: Callable[[str], None], _: Path) -> None:
    """Ship and score what a run has trained; what cannot be is said, and holds up nobody."""
    for member in members:
        try:
            keep_curve(zoo, member, run)
            ship(member, run)
            add_missing_lines(zoo, member.view)
            say(f"{member.name}: shipped")
        except UserError as error:
            say(f"{member.name}: failed: {error}")
