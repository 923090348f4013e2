"""One training run: an algorithm on an id, into a folder that says how it was made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from fpg_bench.errors import UserError
from fpg_bench.evaluation.yardstick import Yardstick
from fpg_bench.training.run import Run
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.spec import RunSpec

LOOKS = 20


def train(
    algorithm: str | type[BaseAlgorithm],
    view_id: str,
    out: str | Path,
    *,
    evaluations: int = LOOKS,
    progress: bool = True,
    restart: bool = False,
    resume: bool = False,
    **words: Any,
) -> Path:
    """Train an algorithm on an id and export the agent; see :func:`train_run`.

    Args:
        algorithm: as for :class:`fpg_bench.training.spec.RunSpec`.
        view_id: as there.
        out, evaluations, progress, restart, resume: as for :func:`train_run`.
        **words: the others of ``RunSpec`` (``seed``, ``steps``, ``hyperparams``, ``field``, ``transcript``,
            ``llm``, ``against``, ``start``), and its games' options by their names.
    """
    how: dict[str, Any] = {"progress": progress, "restart": restart, "resume": resume}
    return train_run(RunSpec.of(algorithm, view_id, **words), out, evaluations=evaluations, **how)


def train_run(
    spec: RunSpec,
    out: str | Path,
    *,
    evaluations: int = LOOKS,
    progress: bool = True,
    restart: bool = False,
    resume: bool = False,
) -> Path:
    """Train a run and export the agent.

    The folder then holds ``run.json``, ``evaluations.jsonl`` (what the policy was worth on the way) with
    its picture ``curve.png``, ``model.zip``, the TensorBoard log and ``agent/`` (``agent.json``,
    ``policy.onnx``). A finished run is not repeated. A stopped or killed one leaves a checkpoint that is at
    most a minute old; resumed, it plays new matches and ends with as many steps as if it had never stopped.

    A language model plans beside the game: each round flies the newest plan that is there. How far that is
    behind depends on the server's speed, so ``transcript.jsonl`` keeps what each round flew.

    Args:
        spec: what is trained.
        out: the run's folder.
        evaluations: how many times the policy is scored on the way; 0: never.
        progress: whether to draw a bar, or print lines where standard output is no terminal.
        restart: whether to begin an unfinished run of the folder again, from the start.
        resume: whether to go on with an unfinished run; begins it where there is none.

    Returns:
        The agent's folder; where both sides learn, it holds one of each.

    Raises:
        UserError: something unknown or out of range, a policy that can't be exported, or a folder that holds
            another or an unfinished run, or that another process trains in.
        KeyboardInterrupt: stopped by the user; says what is saved.
    """
    torch.set_num_threads(1)
    if restart and resume:
        raise UserError("resume goes on with a run, restart begins it again: say one of them")
    run = Run(spec, RunFolder(Path(out)))
    run.begin()
    with run.folder.locked():
        state = run.folder.found(run.about, again=restart or resume)
        if state is None or not state.get("finished"):
            yardsticks = {
                side: Yardstick(field, scenario=run.games.core.scenario, side=side)
                for side, field in zip(run.sides, run.fields, strict=True)
                if evaluations
            }
            run.go_on(state) if state is not None and resume else run.folder.clear()
            run.learn(yardsticks, evaluations, progress)
            run.finish()
    return run.folder.agent


def is_finished(spec: RunSpec, out: str | Path) -> bool:
    """Whether a folder holds this very run, finished.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
    """
    run = Run(spec, RunFolder(Path(out)))
    state = run.folder.found(run.about, again=True)
    return bool(state and state.get("finished"))
