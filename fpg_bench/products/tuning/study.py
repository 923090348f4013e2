"""Studies: their task, their database and their seeded sampler."""

from __future__ import annotations

import json
import sqlite3
import time
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import optuna
import sqlalchemy
from optuna.distributions import BaseDistribution as Distribution
from optuna.storages import RDBStorage, RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, first_line, nearest
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_own_folder
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.schema import Strict, parse
from fpg_bench.evaluation.suite import load_suite, suite_of
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.card import Game
from fpg_bench.products.tuning.space import Space, load_space, to_params
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.rl_zoo3_format import Entry

DATABASE = "study.db"
HEARTBEAT_S = 60  # a trial counts as lost after three missed heartbeats
MAX_RETRIES = 2  # of a trial whose worker was lost
N_EVALS = 4  # of a policy during the budget of a seed, one per quarter
FIRST_SEED = 100_000  # training seed of trials, far from those of shipped agents
FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)

_TASK = "task"
_LOCK_TIMEOUT_S = 60  # of SQLite
_CONNECT_TIMEOUT_S = 10  # of PostgreSQL
# Raised if several workers create the tables at the same time.
_CREATION_RACES = (sqlalchemy.exc.IntegrityError, sqlalchemy.exc.ProgrammingError)
_CREATION_ATTEMPTS = 20
_CREATION_PAUSE_S = 0.2


class Task(Strict):
    """Everything that decides a trial's score; a study stores it and refuses trials of another task.

    Attributes:
        algorithm: name of the algorithm that is trained.
        game: the game.
        steps: training budget of one seed.
        n_seeds: number of training seeds of a trial.
        suite: the suite on which a trained policy is scored.
        suite_hash: hash of the suite.
        rounds: number of rounds per rival.
        space: the search space.
        hyperparameters: the values that are not tuned, an entry of a hyper-parameter file.
    """

    algorithm: str
    game: Game
    steps: int
    n_seeds: int
    suite: str
    suite_hash: str
    rounds: int
    space: Space
    hyperparameters: Entry

    @property
    def seeds(self) -> list[int]:
        """Training seeds of each trial."""
        return [FIRST_SEED + index for index in range(self.n_seeds)]

    def check_same(self, stored: object, where: str) -> None:
        """Raise UserError if a study stores a different task."""
        own = self.model_dump(mode="json")
        if not isinstance(stored, dict) or stored.keys() != own.keys():
            raise UserError(
                f"{where}: was not made by fpg-bench tune of this version; "
                "choose another --study-name or --out"
            )
        for key, present in own.items():
            if (before := stored[key]) == present:
                continue
            difference = f"{key.replace('_', ' ')} {before}, not {present}"
            if isinstance(present, dict) and isinstance(before, dict):
                names = sorted(name for name in {*present, *before} if before.get(name) != present.get(name))
                difference = f"another {key} ({', '.join(names)})"
            raise UserError(
                f"{where}: was made with {difference}; continue it with the same options, or choose another "
                "--study-name or --out"
            )


def make_task(
    algorithm: str,
    game: GameSpec | str,
    *,
    n_seeds: int,
    steps: int | None = None,
    space: str | Path | None = None,
    hyperparams: str | Path | None = None,
    suite: str | None = None,
    rounds: int = 100,
    allow: Collection[str] = (),
) -> Task:
    """Build a task from the arguments of :func:`fpg_bench.products.tuning.tune.tune`.

    Raises:
        UserError: an argument is unknown or out of range.
    """
    for name, value in (("n_seeds", n_seeds), ("steps", steps), ("rounds", rounds)):
        if value is not None:
            integer(value, name)
    game = GameSpec.of(game, allow=allow)
    registered, sides = find_algorithm(algorithm), game.sides
    registered.check_sides(game.id, sides)
    game.to_dict()  # refuses objects, which a study cannot store
    parameters = load_hyperparameters(registered, game, hyperparams, allow=allow)
    if not (parameters.n_timesteps or steps):
        raise UserError(f"steps: {registered.name} has no hyper-parameter file with a budget; give the steps")
    entry = parameters.entry() | {"n_timesteps": parameters.n_timesteps or steps}
    usual = [suite_of(game, side) for side in sides]
    name = suite or usual[0]
    scoring = load_suite(name, allow=allow)
    if name not in usual:
        scoring.check_scenario(game.resolve())
    if scoring.side not in sides:
        raise UserError(f"suite {name}: measures the {scoring.side}; in {game.id} the {sides[0]} learns")
    values = load_space(registered.search, Path(space) if space else None, game.action_mode)
    check_allowed({name: each.model_dump() for name, each in values.items()}, allow, f"search space {space}")
    return Task(
        algorithm=algorithm,
        game=game,
        steps=steps or max(1, entry["n_timesteps"] // 2),
        n_seeds=n_seeds,
        suite=name,
        suite_hash=scoring.hash,
        rounds=rounds,
        space=values,
        hyperparameters=_storable(entry, "hyper-parameters"),
    )


def _storable(values: Entry, where: str) -> Entry:
    """Return values as they are read from JSON, in which a study stores them."""
    try:
        stored: Entry = json.loads(json.dumps(values))
    except TypeError as error:
        raise UserError(
            f"{where}: must be storable as JSON, so use names instead of objects: {error}"
        ) from error
    return stored


class Storage(RDBStorage):
    """Database of studies.

    Args:
        url: SQLAlchemy URL.
        where: name of the database in messages, without the password.
    """

    def __init__(self, url: str, where: str) -> None:
        self.where = where
        arguments: dict[str, Any] = {"pool_pre_ping": True}
        if url.startswith("sqlite"):
            arguments["connect_args"] = {"timeout": _LOCK_TIMEOUT_S}
        elif url.startswith("postgresql"):
            arguments["connect_args"] = {"connect_timeout": _CONNECT_TIMEOUT_S}
        with _no_experimental_warnings():
            super().__init__(
                url,
                arguments,
                heartbeat_interval=HEARTBEAT_S,
                grace_period=3 * HEARTBEAT_S,
                heartbeat_stale_trial_callback=RetryHeartbeatStaleTrialCallback(MAX_RETRIES),
            )
        if url.startswith("sqlite"):
            _begin_immediate(self.engine)

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Turn errors of the database into a UserError of one line."""
        try:
            yield
        except UserError:
            raise
        except Exception as error:
            if down := _database_error(error):
                raise UserError(
                    f"{self.where}: the database failed ({down}); once it works, run the same command again, "
                    "finished trials are kept"
                ) from error
            raise

    def record_heartbeat(self, trial_id: int) -> None:
        """Record a heartbeat; ignore a failure, which would end Optuna's thread."""
        try:
            super().record_heartbeat(trial_id)
        except Exception as error:
            if not _database_error(error):
                raise


def open_storage(out: Path, url: str | None = None, *, must_exist: bool = False) -> Storage:
    """Open the SQLite database in a study's folder, or any database by URL.

    Args:
        out: the study's folder.
        url: such as ``postgresql+psycopg://user@host/database``; None for ``study.db`` in the folder.
        must_exist: refuse a folder without ``study.db`` instead of creating it.

    Raises:
        UserError: the database cannot be opened, the folder holds something else, or the extra ``postgres``
            is not installed.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    file = out.absolute() / DATABASE
    if url is None:
        if must_exist and not file.is_file():
            raise UserError(f"{out}: holds no study")
        check_own_folder(out, DATABASE, "study")
        where = f"storage {file}"
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"{where}: cannot be opened: {error.strerror}") from error
        url = sqlalchemy.URL.create("sqlite", database=str(file)).render_as_string()
    else:
        where = f"storage {_without_password(url)}"
        if url.startswith("postgresql+psycopg:"):
            require_extra("postgres", "psycopg")
    for attempt in range(_CREATION_ATTEMPTS):
        try:
            return Storage(url, where)
        except Exception as error:
            is_race = isinstance(error, _CREATION_RACES) or "already exists" in str(error)
            if not is_race or attempt + 1 == _CREATION_ATTEMPTS:
                message = _database_error(error) or first_line(error)
                raise UserError(f"{where}: cannot be opened: {message}") from error
            time.sleep(_CREATION_PAUSE_S)
    raise AssertionError


def _begin_immediate(engine: sqlalchemy.Engine) -> None:
    """Lock a SQLite database at the start of each transaction, so that workers wait instead of failing."""

    @sqlalchemy.event.listens_for(engine, "connect")
    def connect(connection: sqlite3.Connection, record: object) -> None:
        connection.isolation_level = None  # the driver itself begins no transactions

    @sqlalchemy.event.listens_for(engine, "begin")
    def begin(connection: sqlalchemy.Connection) -> None:
        connection.exec_driver_sql("BEGIN IMMEDIATE")

    engine.dispose()  # closes earlier connections


def _without_password(url: str) -> str:
    try:
        return sqlalchemy.make_url(url).render_as_string(hide_password=True)
    except sqlalchemy.exc.ArgumentError as error:
        raise UserError(
            "storage: expected a URL like postgresql+psycopg://user@host/database; a password is best left "
            "to the environment"
        ) from error


def _database_error(error: BaseException | None) -> str | None:
    """Return the message of a database error among an exception's causes; None if there is none."""
    while error is not None:
        if isinstance(error, sqlalchemy.exc.SQLAlchemyError):
            return first_line(getattr(error, "orig", None) or error)
        error = error.__cause__ or error.__context__
    return None


@contextmanager
def _no_experimental_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        yield


class SeededSampler(optuna.samplers.BaseSampler):
    """TPE with a new sampler for each trial, so that a resumed study continues its sequence of values.

    The seed is the number of earlier trials that are not retries. A retried trial has the seed of its first
    try.
    """

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        """Make the sampler of this trial."""
        trials = study.get_trials(deepcopy=False)
        first = trial.number if (retried := _retried(trial)) is None else retried
        seed = sum(_retried(earlier) is None for earlier in trials[:first])
        self._sampler = optuna.samplers.TPESampler(seed=seed)

    def infer_relative_search_space(self, study: optuna.Study, trial: FrozenTrial) -> dict[str, Distribution]:
        """Return the parameters that are sampled together."""
        return self._sampler.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, Distribution]
    ) -> dict[str, Any]:
        """Return the values of the parameters that are sampled together."""
        return self._sampler.sample_relative(study, trial, search_space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: Distribution
    ) -> Any:
        """Return the value of any other parameter."""
        return self._sampler.sample_independent(study, trial, param_name, param_distribution)


def _retried(trial: FrozenTrial) -> int | None:
    """Return the number of the trial that this one is a retry of."""
    with _no_experimental_warnings():
        return RetryHeartbeatStaleTrialCallback.retried_trial_number(trial)


def retry(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue a trial with the values of one that was interrupted."""
    with _no_experimental_warnings():
        RetryHeartbeatStaleTrialCallback()(study, trial)


def open_study(storage: Storage, name: str, task: Task) -> optuna.Study:
    """Create a study, or load the one of that name.

    A new study queues one trial: the present hyper-parameters, as far as they lie in the space. Asynchronous
    successive halving prunes from half of a seed's budget on: fast learners need not end best.

    Raises:
        UserError: the study has another task, or the database fails.
    """
    with storage.errors():
        study = optuna.create_study(
            storage=storage,
            study_name=name,
            direction="maximize",
            sampler=SeededSampler(),
            pruner=optuna.pruners.SuccessiveHalvingPruner(min_resource=N_EVALS // 2, reduction_factor=2),
            load_if_exists=True,
        )
        stored = study.user_attrs
        if _TASK in stored or any(t.state != TrialState.WAITING for t in study.get_trials(deepcopy=False)):
            task.check_same(stored.get(_TASK), f"study {name!r} in {storage.where}")
        else:
            study.enqueue_trial(to_params(task.space, task.hyperparameters), skip_if_exists=True)
            study.set_user_attr(_TASK, task.model_dump(mode="json"))
    return study


def load_study(storage: Storage, name: str | None) -> tuple[optuna.Study, Task]:
    """Load a study and its task.

    Args:
        storage: database of the study.
        name: the study's name; None for the only one in the storage.

    Raises:
        UserError: there is no such study, there are several, or ``fpg-bench tune`` did not make it.
    """
    with storage.errors():
        names = optuna.get_all_study_names(storage)
        if name is None and len(names) != 1:
            problem = (
                f"holds several, choose one with --study-name: {', '.join(names)}"
                if names
                else "holds no study"
            )
            raise UserError(f"{storage.where}: {problem}")
        if name is not None and name not in names:
            raise UserError(f"{storage.where}: no study {name!r}{nearest(name, names)}")
        study = optuna.load_study(study_name=name or names[0], storage=storage)
        where = f"study {study.study_name!r} in {storage.where}"
        if _TASK not in study.user_attrs:
            raise UserError(f"{where}: was not made by fpg-bench tune")
        where += ": was made by another version of fpg-bench, so search anew"
        return study, parse(Task, study.user_attrs[_TASK], where)


def count_finished(study: optuna.Study) -> int:
    """Count the trials that are complete or pruned."""
    return len(study.get_trials(deepcopy=False, states=FINISHED))


def state_of(trial: FrozenTrial) -> str:
    """Return how a trial ended: the error that it failed with, or its state.

    A pruned trial has the score of its first seeds only, which is not compared with a score over all.
    """
    if error := trial.user_attrs.get("error"):
        return f"failed ({error})"
    is_pruned = trial.state == TrialState.PRUNED
    return f"pruned at evaluation {trial.last_step}" if is_pruned else trial.state.name.lower()


def finished_text(study: optuna.Study) -> str:
    """Return how many trials are finished, and how many of them were pruned or failed."""
    trials = study.get_trials(deepcopy=False, states=FINISHED)
    kinds = {word: sum(state_of(trial).startswith(word) for trial in trials) for word in ("pruned", "failed")}
    parts = ", ".join(f"{count} {word}" for word, count in kinds.items() if count)
    return f"{len(trials)} finished" + (f" ({parts})" if parts else "")


def best_trials(study: optuna.Study, n_trials: int) -> list[FrozenTrial]:
    """Return the best complete trials, best first; of trials with equal parameters the best one."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    distinct: dict[str, FrozenTrial] = {}
    for trial in sorted(complete, key=lambda trial: (-(trial.value or 0.0), trial.number)):
        distinct.setdefault(repr(sorted(trial.params.items())), trial)
    return list(distinct.values())[:n_trials]
