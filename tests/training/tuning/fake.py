"""A study whose trials take a moment and train nothing: for what storages and workers do.

As a program: ``python -m tests.training.tuning.fake FOLDER URL TRIALS SECONDS HOST`` is one worker
(a dash: no URL, this host).
"""

import socket
import sys
import time
from functools import partial
from pathlib import Path

import optuna

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning import worker as tuning_worker
from fpg_bench.training.tuning.storage import open_storage
from fpg_bench.training.tuning.study import finished, open_study
from fpg_bench.training.tuning.task import Task
from fpg_bench.training.tuning.worker import Worker

RANGES = {"x": {"kind": "float", "low": 0.0, "high": 10.0}}


def fake_task(**changes):
    words = {
        "algorithm": "ppo",
        "env_id": "FPG/AllyVsScripted-v0",
        "options": {},
        "steps": 10,
        "seeds": 2,
        "first_seed": 0,
        "suite": "ally-v1",
        "suite_hash": "0",
        "rounds": 1,
        "space": RANGES,
        "hyperparameters": {"x": 5.0},
    }
    return Task(**words | changes)


def highest_x(values, trial, report):
    report(values["x"], 1)
    return Interval(values["x"], values["x"] - 1, values["x"] + 1, "training seeds")


def fake_worker(folder, objective=highest_x, *, url=None, say=print, patience_s=20, lost=(), pruner=None):
    """A worker of the study in a folder or database, and the study."""
    storage = open_storage(Path(folder), url, say=say, patience_s=patience_s, heartbeat_s=1)
    task = fake_task()
    study = open_study(storage, "fake", task, pruner or optuna.pruners.NopPruner())
    suggest = task.ranges().suggest
    return Worker(study, storage, suggest, objective, done=finished, say=say, lost=lost), study


def main(folder, url, trials, seconds, host):
    if host != "-":
        socket.gethostname = lambda: host
    tuning_worker.POLL_S = 0.1
    claim._UNSIGNED_S = 5  # a trial that was handed out as the database went

    def slow(values, trial, report):
        print(f"at work on {trial.number}", flush=True)
        time.sleep(float(seconds))
        return highest_x(values, trial, report)

    try:
        told = partial(print, flush=True)
        worker, _ = fake_worker(folder, slow, url=None if url == "-" else url, say=told)
        worker.run(int(trials))
        assert "torch" not in sys.modules  # a study is kept without it
    except UserError as error:
        sys.exit(f"line: {error}")


if __name__ == "__main__":
    main(*sys.argv[1:])
