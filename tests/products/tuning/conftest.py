"""Workers in processes of their own."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def start():
    """Start a worker of the fake study; it ends with the test."""
    running = []

    def start(folder, *, url="-", n_trials=3, mode="quick"):
        words = [sys.executable, "-m", "tests.products.tuning.fake", folder, url, n_trials, mode]
        process = subprocess.Popen(
            list(map(str, words)),
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # A shell in the background would have it ignore Ctrl-C.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def at_work(start):
    """Start a worker and wait until it has begun a trial, which does not end by itself."""

    def start_and_wait(folder, *, mode="wait", **options):
        process = start(folder, mode=mode, **options)
        assert any(line.startswith("at work") for line in process.stdout), process.stderr.read()
        return process

    return start_and_wait
