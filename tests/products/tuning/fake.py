"""A study whose trials train nothing, to test storages and workers.

As a program: ``python -m tests.products.tuning.fake FOLDER URL N_TRIALS MODE`` is one worker; a dash stands
for no URL. MODE is ``quick``, ``both`` (trials end once two workers are at work), ``wait`` (trials end with
Ctrl-C only) or ``deaf`` (not even with the first).
"""

import contextlib
import os
import sys
import time
from pathlib import Path

import sqlalchemy

from fpg_bench.common.errors import UserError
from fpg_bench.common.output import print_messages
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.tuning.space import suggest
from fpg_bench.products.tuning.study import Task, open_storage, open_study
from fpg_bench.products.tuning.worker import run_worker

TASK = {
    "algorithm": "ppo",
    "game": GameSpec("FPG/AllyVsScripted-v0"),
    "steps": 10,
    "n_seeds": 2,
    "suite": "ally-v2",
    "suite_hash": "0",
    "rounds": 1,
    "space": {"x": {"kind": "float", "low": 0.0, "high": 10.0}},
    "hyperparameters": {"x": 5.0},
}


def fake_task(**changes):
    return Task.model_validate(TASK | changes)


def open_fake(folder, url=None):
    """Open the fake study in a folder or database."""
    storage = open_storage(Path(folder), url)
    return storage, open_study(storage, "fake", fake_task())


def highest_x(trial):
    x = suggest(fake_task().space, trial)["x"]
    trial.report(x, 1)
    return x


def work(folder, n_trials, objective=highest_x, *, url=None):
    """Run a worker of the fake study in this process; return the study."""
    storage, study = open_fake(folder, url)
    run_worker(study, storage, lambda check_stop: objective, n_trials)
    return study


def miss_heartbeats(folder, url=None):
    """Date all heartbeats back, as if their workers had been silent for long."""
    with open_fake(folder, url)[0].engine.begin() as connection:
        connection.execute(sqlalchemy.text("UPDATE trial_heartbeats SET heartbeat = '2020-01-01 00:00:00'"))


def main(folder, url, n_trials, mode):
    def is_over():
        return mode == "quick" or (mode == "both" and len(list(Path(folder).glob("*.at_work"))) == 2)

    def make_objective(check_stop):
        def objective(trial):
            check_stop()
            value = highest_x(trial)
            print(f"at work on {trial.number}", flush=True)
            Path(folder, f"{os.getpid()}.at_work").touch()
            while not is_over():
                time.sleep(0.01)
                if mode != "deaf":
                    check_stop()
            return value

        return objective

    print_messages()
    try:
        storage, study = open_fake(folder, None if url == "-" else url)
        with contextlib.suppress(KeyboardInterrupt):
            run_worker(study, storage, make_objective, int(n_trials))
            assert "torch" not in sys.modules  # the database is kept without it
            return
        sys.exit(130)
    except UserError as error:
        sys.exit(f"line: {error}")


if __name__ == "__main__":
    main(*sys.argv[1:])
