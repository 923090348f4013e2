"""Scores of a training loop of one's own, in the files that ``fpg-bench train`` writes."""

from __future__ import annotations

import re
from pathlib import Path

from fpg_bench.common.checks import finite, integer, of_kind
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import as_path
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.policy_evaluator import MATCHES, PolicyEvaluator
from fpg_bench.evaluation.run_description import EVALUATIONS, FILE, RunDescription
from fpg_bench.players.player import PlayerSpec
from fpg_bench.players.registry import player_name

_SEED = re.compile(r"seed_(\d+)")


def log_evaluation(
    folder: str | Path,
    model: PlayerSpec,
    steps: int,
    seconds: float,
    *,
    suite: str = "ally-v2",
    algorithm: str | None = None,
    training_seed: int | None = None,
    rounds: int = MATCHES,
) -> Row:
    """Score a model on tuning seeds during its training, and append the score to a folder.

    ``fpg-bench curves FOLDER`` draws it, alone, or several seeds in ``FOLDER/seed_0``, ``FOLDER/seed_1``, ...
    as one curve, beside runs of ``fpg-bench train``.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     row = log_evaluation(folder, "expert", steps=1000, seconds=2.5, rounds=1)
    >>> row["steps"], row["side"]
    (1000, 'ally')

    Args:
        folder: a folder for this training alone; it is made if need be.
        model: anything with ``predict``, or a player's name.
        steps: environment steps so far.
        seconds: training time so far, without evaluations.
        suite: a suite's name or YAML file.
        algorithm: name of the algorithm; None: the model's class.
        training_seed: None: that of a folder called ``seed_K``, otherwise 0.
        rounds: per rival; see :class:`fpg_bench.PolicyEvaluator`.

    Returns:
        The row: ``steps``, ``seconds``, ``side`` and what :meth:`fpg_bench.PolicyEvaluator.score` returns.

    Raises:
        UserError: a folder that holds something else, another training, or a score of so many steps; an
            unknown suite, or a model that cannot play its side.
    """
    steps, seconds = integer(steps, "steps", 0), finite(seconds, "seconds")
    folder = as_path(folder, "folder")
    evaluator = PolicyEvaluator(suite, rounds)
    if training_seed is None:
        training_seed = int(match[1]) if (match := _SEED.fullmatch(folder.resolve().name)) else 0
    about = RunDescription(
        command="fpg_bench.log_evaluation",
        algorithm=of_kind(algorithm or player_name(model), "algorithm", "text", str),
        side=evaluator.suite.side,
        suite=suite,
        training_seed=integer(training_seed, "training_seed", 0),
    )
    file = RowFile(folder / EVALUATIONS, {"side": str, "score": float | int, "steps": int})
    with own_folder(folder, FILE, "training run"):
        if (folder / FILE).exists():
            known = RunDescription.read(folder)
            if differing := [key for key in about.to_dict() if getattr(known, key) != getattr(about, key)]:
                raise UserError(
                    f"{folder}: holds a training of another {differing[0]}; choose another folder"
                )
        if (rows := file.read()) and rows[-1]["steps"] >= steps:
            raise UserError(
                f"{folder}: has a score of {rows[-1]['steps']:,} steps already, so none of {steps:,} can "
                "follow; choose another folder for another training"
            )
        row = {"steps": steps, "seconds": round(seconds, 2), "side": evaluator.suite.side}
        row |= evaluator.score(model)
        if not (folder / FILE).exists():
            about.write(folder)
        file.append([row])
    return row
