"""What a study tunes: everything that decides a trial's score, kept in the study itself."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import find_env
from fpg_bench.evaluation.suite import load_suite, suite_of
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.tuning.space import Space, load_space

ROUNDS = 100
# Training seeds of trials, and of what is trained again: far from those that the zoo ships.
TRIAL_SEED = 100_000
FRESH_SEED = 200_000
_WORDS = {
    "algorithm": "algorithm",
    "env_id": "id",
    "options": "games' options",
    "steps": "steps",
    "seeds": "seeds",
    "first_seed": "first seed",
    "suite": "suite",
    "suite_hash": "version of the suite",
    "rounds": "rounds",
    "space": "search space",
    "hyperparameters": "hyper-parameters",
}


@dataclass(frozen=True)
class Task:
    """What a study tunes.

    Attributes:
        algorithm, env_id: what is trained, and on what.
        options: of the games; see :class:`fpg_bench.envs.core.SingleAgentGame`.
        steps: the budget of one training seed.
        seeds: how many training seeds a trial has. first_seed: the first of them.
        suite: what a trained policy is scored on. field_hash: its version. rounds: per rival.
        space: the search space's ranges.
        hyperparameters: the values that are not searched, a hyper-parameter file's entry.
    """

    algorithm: str
    env_id: str
    options: dict[str, Any]
    steps: int
    seeds: int
    first_seed: int
    suite: str
    suite_hash: str
    rounds: int
    space: dict[str, dict[str, Any]]
    hyperparameters: dict[str, Any]

    def ranges(self) -> Space:
        """The search space."""
        return Space(self.space)

    def check_same(self, found: Any, where: str) -> None:
        """Raise UserError where a study is another one than this: ``found`` is what it holds."""
        mine = dataclasses.asdict(self)
        if not isinstance(found, dict):
            raise UserError(f"{where}: was not made by fpg-bench tune; choose another --name")
        for key, word in _WORDS.items():
            if found.get(key) != mine[key]:
                raise UserError(
                    f"{where}: was made with {_other(word, found.get(key), mine[key])}; continue it with the "
                    "same words, or choose another --name or --out"
                )


def _other(word: str, found: Any, mine: Any) -> str:
    if isinstance(mine, dict):
        keys = sorted(k for k in {*mine, *(found or {})} if (found or {}).get(k) != mine.get(k))
        return f"another {word} ({', '.join(keys)})"
    return f"{word} {found}, not {mine}" if word != "search space" else f"another {word}"


def make_task(
    algorithm: str,
    env_id: str,
    *,
    seeds: int,
    steps: int | None = None,
    space: str | Path | None = None,
    hyperparams: str | Path | None = None,
    suite: str | None = None,
    rounds: int = ROUNDS,
    **options: Any,
) -> Task:
    """What a study is to tune, from words as the command line takes them; ``options`` are of the games.

    Raises:
        UserError: something unknown or out of range.
    """
    for name, value in (("seeds", seeds), ("steps", steps), ("rounds", rounds)):
        if value is not None:
            whole(value, name)
    view = find_env(env_id)
    options = {name: value for name, value in options.items() if value is not None}
    found = find_algorithm(algorithm)
    values = _entry(found, view.id, hyperparams, steps, options.get("path"))
    for what, given in (("options", options), ("hyper-parameters", values)):
        try:
            json.dumps(given)
        except TypeError as error:
            raise UserError(f"{what}: a study keeps them, so name everything by words: {error}") from error
    name = suite or suite_of(view.id, options)
    measured = load_suite(name)
    if measured.side != view.side:
        raise UserError(f"suite {name}: measures the {measured.side}; in {view.id} the {view.side} learns")
    return Task(
        algorithm=algorithm,
        env_id=view.id,
        options=options,
        steps=steps or max(1, values["n_timesteps"] // 2),
        seeds=seeds,
        first_seed=TRIAL_SEED,
        suite=name,
        suite_hash=measured.hash,
        rounds=rounds,
        space=load_space(found.base, Path(space) if space else None).ranges,
        hyperparameters=values,
    )


def _entry(
    algorithm: Algorithm, env_id: str, file: str | Path | None, steps: int | None, path: Any
) -> dict[str, Any]:
    """What the hyper-parameter file says for the id; a class of the user's may have none."""
    found = load_hyperparameters(algorithm, env_id, file, path=path)
    if not (found.n_timesteps or steps):
        raise UserError(f"steps: {algorithm.name} has no hyper-parameter file that says how many; name them")
    return found.entry() | {"n_timesteps": found.n_timesteps or steps}
