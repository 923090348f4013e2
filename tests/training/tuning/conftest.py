"""Workers in processes of their own."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    """A worker of this process looks often at what the others do, and tries a storage again at once."""
    monkeypatch.setattr("fpg_bench.training.tuning.storage._AGAIN_S", 0.1)
    monkeypatch.setattr("fpg_bench.training.tuning.worker.POLL_S", 0.1)


@pytest.fixture
def started():
    """Starts a worker of the fake study; ends it with the test."""
    running = []

    def start(folder, *, url="-", trials=3, seconds=0.0, host="-"):
        words = [sys.executable, "-m", "tests.training.tuning.fake", folder, url, trials, seconds, host]
        process = subprocess.Popen(
            list(map(str, words)),
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # A shell in the background would have it ignore Ctrl-C.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def at_work(started):
    """A worker that has begun its first trial and does not end it."""

    def start(folder, **words):
        process = started(folder, seconds=600, **words)
        for line in process.stdout:
            if line.startswith("at work"):
                return process
        raise AssertionError(process.stderr.read())

    return start
