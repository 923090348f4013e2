"""Worker that runs trials of a study until enough are finished, and requeues an interrupted trial."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from functools import partial

import optuna
from optuna.study import MaxTrialsCallback
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import StopRequest
from fpg_bench.products.tuning.study import FINISHED, Storage, count_finished, finished_text, retry, state_of

MAX_FAILURES = 5  # in a row, after which the search space is considered wrong

_logger = logging.getLogger(__name__)


def run_worker(
    study: optuna.Study,
    storage: Storage,
    make_objective: Callable[[Callable[[], None]], Callable[[optuna.Trial], float]],
    n_trials: int,
    timeout: float | None = None,
) -> None:
    """Run trials of a study in this process until enough are finished; other workers may run in parallel.

    Args:
        study: the study.
        storage: database of the study.
        make_objective: called with a function that the objective has to call often, and that raises
            KeyboardInterrupt after Ctrl-C; returns the objective.
        n_trials: number of finished trials of the study.
        timeout: seconds after which no new trial begins.

    Raises:
        UserError: the database fails, or every trial fails.
        KeyboardInterrupt: stopped by the user. The running trial has been queued again.
    """
    begun: list[int] = []
    with storage.errors(), StopRequest(is_deferred=False) as stop:
        if count_finished(study) >= n_trials:
            _logger.info("%s", _progress(study, n_trials))
            return
        objective = make_objective(stop.check)
        stop.is_deferred = True

        def run(trial: optuna.Trial) -> float:
            begun.append(trial.number)
            # Optuna's thread may not have done so before the worker is killed; then nobody would miss it.
            storage.record_heartbeat(trial._trial_id)
            return objective(trial)

        def stop_if_requested(study: optuna.Study, trial: FrozenTrial) -> None:
            if stop.is_set:
                study.stop()

        callbacks: list[Callable[[optuna.Study, FrozenTrial], None]] = [
            partial(_log_trial, n_trials=n_trials),
            # the trials of other workers, too, which will be finished
            MaxTrialsCallback(n_trials, (*FINISHED, TrialState.RUNNING)),
            stop_if_requested,
            _check_failures,
        ]
        try:
            study.optimize(run, timeout=timeout, callbacks=callbacks)
        except KeyboardInterrupt:
            with contextlib.suppress(Exception):  # without the database, missing heartbeats reveal it
                trial = study.get_trials(deepcopy=False)[begun[-1]]
                if trial.state == TrialState.FAIL:
                    retry(study, trial)
            raise
        except ValueError as error:
            if "Cannot tell a" in str(error):  # Optuna's message for a trial that is no longer running
                raise UserError(
                    f"trial {begun[-1]}: gave no heartbeat for long, so that another worker has queued it "
                    "again; run the same command again"
                ) from error
            raise
        stop.check()


def _log_trial(study: optuna.Study, trial: FrozenTrial, n_trials: int) -> None:
    is_complete = trial.state == TrialState.COMPLETE
    result = f"score {trial.value:.1f}" if is_complete else state_of(trial)
    seconds = 0.0 if trial.duration is None else trial.duration.total_seconds()
    _logger.info("trial %d: %s, %.0f s; %s", trial.number, result, seconds, _progress(study, n_trials))


def _progress(study: optuna.Study, n_trials: int) -> str:
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    best = max(complete, key=lambda trial: (trial.value or 0.0, -trial.number), default=None)
    suffix = "" if best is None else f", best {best.value:.1f} (trial {best.number})"
    return f"{finished_text(study)}, {n_trials} asked for{suffix}"


def _check_failures(study: optuna.Study, trial: FrozenTrial) -> None:
    """Raise UserError if the last trials have all failed."""
    errors = [t.user_attrs.get("error") for t in study.get_trials(deepcopy=False, states=FINISHED)]
    if len(errors) >= MAX_FAILURES and all(errors[-MAX_FAILURES:]):
        raise UserError(f"{MAX_FAILURES} trials in a row failed, the last: {errors[-1]}")
