"""Training of the board's own responses to entries."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.players.agent import read_card
from fpg_bench.products.leaderboard.exploited import describe, lowest_known
from fpg_bench.products.leaderboard.response_recipe import OWN, RECIPE
from fpg_bench.products.leaderboard.response_results import play_response, result_store, write_results
from fpg_bench.products.leaderboard.responses import read_response
from fpg_bench.products.leaderboard.targets import Target, answered_entries

_logger = logging.getLogger(__name__)


def exploit(
    board: str | Path, work: str | Path, names: Sequence[str] = (), *, workers: Workers | int = 1
) -> list[str]:
    """Make the recipe's responses to verified entries of a board, and play them.

    A stopped call is resumed: each response is on the board, with its result, as soon as it is finished.

    Args:
        board: the leaderboard's folder.
        work: a folder for the trainings, ``<track>/<entry>/<name>`` each.
        names: the entries, ``track/name`` each; empty: all allies and opponents.
        workers: number of trainings at once, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        What each of these entries keeps, one line each.

    Raises:
        UserError: no such board or entry, or a training that fails.
        KeyboardInterrupt: stopped by the user.
    """
    board = Path(board)
    targets = list(answered_entries(board, names, every=True))
    jobs = [
        Job(
            f"{target.name}/{OWN}{number}",
            partial(_train, target, number, Path(work).absolute() / target.name / f"{OWN}{number}"),
            partial(_publish, board, target, number),
            partial(_is_made, board, target, number),
        )
        for target in targets
        for number in range(RECIPE.n_responses)
    ]
    failed = run_jobs(jobs, workers)
    check_all_done(failed)
    write_results(board, result_store(board).known(_logger.info), ())  # in the order of verification
    lowest = lowest_known(board, targets)
    return [f"{target.name}: {describe(lowest[target.name])}" for target in targets]


def _train(target: Target, number: int, folder: Path) -> Path:
    """Train a response; return the folder of its agent."""
    from fpg_bench.training.config import RunConfig
    from fpg_bench.training.train import train

    part = target.parts[number % len(target.parts)]
    seed = RECIPE.seed(part.fingerprint, number)
    config = RunConfig(RECIPE.algorithm, RECIPE.game(target, number), seed, RECIPE.steps)
    train(config, folder, evaluations=0, progress=False, resume=True)
    return folder / "agent"


def _publish(board: Path, target: Target, number: int, agent: Path) -> None:
    """Copy a response to the board, and play it."""
    folder = board / "responses" / target.name / f"{OWN}{number}"
    read_card(agent).write(folder, (agent / "policy.onnx").read_bytes())
    result_store(board).add(play_response(read_response(folder, target, inspect_onnx=False)))


def _is_made(board: Path, target: Target, number: int) -> bool:
    """Return True if a response of the recipe is on the board, with its result."""
    folder = board / "responses" / target.name / f"{OWN}{number}"
    try:
        response = read_response(folder, target, inspect_onnx=False)
    except UserError:
        return False
    result = result_store(board).known(_logger.info).get(response.key)
    return result is not None and result.is_of(response)
