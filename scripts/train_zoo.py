"""Train every agent of the zoo that is missing, ship and evaluate it, and write the zoo's page.

python scripts/train_zoo.py [--only ally-scripted/ppo] [--n-jobs 2]    trains; run it again to resume
python scripts/train_zoo.py --tables    adds missing records and drops those that are there twice, on the
                                        board, or of no suite; writes baselines/README.md and its pictures
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path

from command import run
from zoo_page import keep_curve, write_page

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.ids import DUEL, ORACLES, SCRIPTED, sides_of
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, run_jobs
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import EvaluatedPlayer, player_entry
from fpg_bench.evaluation.record import Record, read_record
from fpg_bench.evaluation.store import Store, pairings
from fpg_bench.evaluation.suite import Rival, Suite, load_suite
from fpg_bench.players.agent import load_agent
from fpg_bench.products.zoo.zoo import Zoo, ZooAgent, ZooGroup, load_zoo
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

_LOCK = "zoo.lock"
_logger = logging.getLogger("fpg_bench.scripts.train_zoo")


def train_zoo(zoo: Zoo, runs: Path, only: str | None = None, workers: int = 2) -> list[str]:
    """Train every agent that is missing, ship it and evaluate it.

    Args:
        zoo: the zoo.
        runs: folder of the runs, ``<group>/<algorithm>/seed_<k>``.
        only: ``group``, ``group/algorithm`` or ``group/algorithm/seed_k``; None for all.
        workers: number of trainings at once, one thread each.

    Returns:
        The names of the agents that are still missing because something failed.

    Raises:
        UserError: no agent has the name ``only``, or another process trains into ``runs``.
        KeyboardInterrupt: stopped by the user; the trainings have saved their checkpoints.
    """
    Workers(workers)  # refuses no number before anything begins
    missing = [agent for agent in zoo.members(only) if not agent.shipped]
    by_run: dict[Path, list[ZooAgent]] = {}
    for agent in missing:
        by_run.setdefault(run_folder(agent, runs).absolute(), []).append(agent)
    jobs = []
    for folder, agents in by_run.items():
        make = partial(train, run_config(agents[0]), folder, progress=False, resume=True)
        jobs.append(Job(agents[0].name, make, partial(_ship_and_evaluate, zoo, agents, folder)))
    with locked(runs / _LOCK):
        run_jobs(jobs, workers)
    return [agent.name for agent in missing if not agent.shipped]


def run_folder(agent: ZooAgent, runs: Path) -> Path:
    """Return the folder of an agent's run; both sides of a duel share one."""
    group = agent.group
    name = group.name.replace(f"-{group.side}", "") if group.id == DUEL else group.name
    return runs / name / agent.algorithm / f"seed_{agent.seed}"


def run_config(agent: ZooAgent) -> RunConfig:
    """Return the run that trains an agent."""
    group = agent.group
    suite = None if group.id == DUEL else group.training_suite
    hyperparams = group.hyperparams.get(agent.algorithm)
    return RunConfig(agent.algorithm, group.game, agent.seed, agent.steps, hyperparams, suite=suite)


def _ship_and_evaluate(zoo: Zoo, agents: Sequence[ZooAgent], run: Path, _: Path) -> None:
    """Ship and evaluate the agents of a run; a failure is logged, and the others go on."""
    for agent in agents:
        try:
            keep_curve(zoo, agent, run)
            ship(agent, run)
            add_missing_records(zoo, agent.group)
            _logger.info(f"{agent.name}: shipped")
        except UserError as error:
            _logger.info(f"{agent.name}: failed: {error}")


def ship(agent: ZooAgent, run: Path) -> None:
    """Copy a finished run's agent to its place in the zoo, ``agent.json`` last.

    Raises:
        UserError: the agent is damaged, or of another budget or seed than the zoo's.
    """
    folder = RunFolder(run).agent_of(agent.group.side, sides_of(agent.group.id))
    card = load_agent(folder).card
    assert card is not None
    made = {"id": card.game.id, "training_steps": card.training_steps, "training_seed": card.training_seed}
    expected = {"id": agent.group.id, "training_steps": agent.steps, "training_seed": agent.seed}
    for key, value in expected.items():
        if made[key] != value:
            raise UserError(f"run {run}: {key} is {made[key]!r}, the zoo asks for {value!r}; remove it")
    for name in ("policy.onnx", "agent.json"):
        write_whole(agent.folder / name, (folder / name).read_bytes())


def add_missing_records(zoo: Zoo, group: ZooGroup) -> list[Record]:
    """Evaluate a group's shipped agents, and the scripts, on its suites where their records are missing.

    Returns:
        All records of the group.
    """
    scripts = [player_entry(name) for name in (*SCRIPTED[group.side], *ORACLES)]
    agents = [agent.entry() for agent in zoo.members(group.name) if agent.shipped]
    records = []
    for suite in map(load_suite, group.suites):
        known = {record.key for record in zoo.read_records(group, suite)}
        for of, entries in ((suite, scripts), (group, agents)):
            missing = [pairing for pairing in pairings(entries, suite) if pairing.key not in known]
            Store(zoo.records_file(of)).fill(missing, progress=partial(_tell, suite))
        records += zoo.read_records(group, suite)
    return records


def _tell(suite: Suite, entry: EvaluatedPlayer, rival: Rival, rounds: int, *of: int) -> None:
    if not rounds and rival == suite.rivals[0]:
        seed = "" if entry.training_seed is None else f"/seed_{entry.training_seed}"
        _logger.info(f"scoring {entry.name}{seed} against {suite.name}")


def compact(zoo: Zoo, group: ZooGroup) -> None:
    """Keep each record of a group and of scripts once, the newest, of its suites, without the board's."""
    suites = [*map(load_suite, group.suites)]
    board = {record.key for suite in suites for record in zoo.read_board(group, suite)}
    _keep(RowFile(zoo.records_file(group)), suites, board)
    for suite in suites:
        _keep(RowFile(zoo.records_file(suite)), [suite], {of.key for of in zoo.read_script_board(suite)})


def _keep(file: RowFile, suites: Sequence[Suite], board: Collection[object]) -> None:
    hashes = {suite.hash[:16] for suite in suites}
    newest = {read_record(row, f"records {file.path}").key: row for row in file.read()}
    if kept := [row for key, row in newest.items() if key[0] in hashes and key not in board]:
        file.replace(kept)
    else:
        file.path.unlink(missing_ok=True)


def main(
    only: str | None = None,
    n_jobs: int = 2,
    runs: Path = Path("runs/zoo"),
    zoo: Path | None = None,
    tables: bool = False,
) -> int:
    """Train, or only write; returns 0 if all went well.

    One group, group/algorithm or group/algorithm/seed_k may be named; a zoo is a folder with a zoo.yml.
    """
    of = load_zoo(zoo)
    failed = not tables and bool(train_zoo(of, runs, only, n_jobs))
    for group in of.groups:
        compact(of, group)
        add_missing_records(of, group)
    print(f"written: {write_page(of)}")
    return int(failed)


if __name__ == "__main__":
    run(main)
