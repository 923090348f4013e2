"""Whose a running trial is, and what becomes of the trials of workers that have died."""

from __future__ import annotations

import contextlib
import datetime
import os
import socket
from collections.abc import Callable, Collection
from pathlib import Path

import optuna
from optuna.trial import FrozenTrial, TrialState

MOST_TRIES = 3
_UNSIGNED_S = 60  # a worker signs a trial right after it is handed out
_SIGNED = "worker"
_OWN = (_SIGNED, "error")  # what is not passed on when a trial is tried again


def sign(trial: optuna.Trial) -> None:
    """Note in a trial which process of which machine runs it."""
    me = {"host": socket.gethostname(), "pid": os.getpid(), "born": _born(os.getpid())}
    trial.set_user_attr(_SIGNED, me)  # at once: others read it at any moment


def is_dead(trial: FrozenTrial, lost: Collection[str] = ()) -> bool:
    """Whether a running trial's worker is known to have died.

    Args:
        trial: a running trial.
        lost: machines of which the user says that they are gone.
    """
    signed = trial.user_attrs.get(_SIGNED)
    if signed is None:  # killed before it could sign
        started = trial.datetime_start
        return started is None or (datetime.datetime.now() - started).total_seconds() > _UNSIGNED_S
    if signed["host"] != socket.gethostname():
        return signed["host"] in lost
    return _born(signed["pid"]) != signed["born"]


def host_of(trial: FrozenTrial) -> str:
    """The machine that runs a trial."""
    return str(trial.user_attrs.get(_SIGNED, {}).get("host", socket.gethostname()))


def is_foreign(trial: FrozenTrial) -> bool:
    """Whether another machine runs the trial."""
    return host_of(trial) != socket.gethostname()


def is_finished(trial: FrozenTrial) -> bool:
    """Whether a trial counts: complete, pruned, failed by itself, or tried often enough."""
    if trial.state != TrialState.FAIL:
        return trial.state.is_finished()
    return "error" in trial.user_attrs or trial.user_attrs.get("tries", 1) >= MOST_TRIES


def recover(study: optuna.Study, lost: Collection[str], say: Callable[[str], None]) -> None:
    """Fail the trials of workers that are dead, and try them again."""
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        if is_dead(trial, lost):
            with contextlib.suppress(ValueError, optuna.exceptions.UpdateFinishedTrialError):
                study.tell(trial.number, state=TrialState.FAIL)  # one worker alone succeeds
                say(f"trial {trial.number}: its worker has died")
                try_again(study, trial)


def try_again(study: optuna.Study, trial: FrozenTrial, blamed: bool = True) -> None:
    """Queue a trial of the same values, unless it has taken its worker with it too often.

    Optuna's own callback would hand the rungs of the halving on as well, and the new trial would begin on
    them.

    Args:
        study: what the trial is of.
        trial: the trial that failed.
        blamed: whether its end counts as a try.
    """
    tries = trial.user_attrs.get("tries", 1) + blamed
    if tries <= MOST_TRIES:
        params = {**trial.system_attrs.get("fixed_params", {}), **trial.params}
        kept = {name: value for name, value in trial.user_attrs.items() if name not in _OWN}
        study.enqueue_trial(params, user_attrs=kept | {"tries": tries})


def _born(pid: int) -> str | None:
    """What tells a process from a later one of the same number; None: there is none."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return _alive(pid)
    return None if fields[0] in "ZX" else fields[19]


def _alive(pid: int) -> str | None:
    """The same where a system has no /proc: only whether it is there."""
    if Path("/proc/self/stat").exists():
        return None
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        pass
    return "there"
