"""Programs as a user starts them, but without the seconds that each spends on importing torch and the like.

Each is a process of its own, with a status and with files for what it prints; see ``program_server.py``.
What a program imports, how it is stopped and what it may use are tested with ``subprocess`` instead.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def python(
    *words: Any, folder: Path | None = None, environment: dict[str, str] | None = None, umask: int = 0o022
) -> subprocess.CompletedProcess[str]:
    """Run ``python WORDS`` and return what comes of it.

    Args:
        words: a script, ``-m`` and a module, or ``-c`` and code; then its own words.
        folder: where it is started; None: here.
        environment: None: that of the tests.
        umask: of the files that it makes.
    """
    with tempfile.NamedTemporaryFile("r") as out, tempfile.NamedTemporaryFile("r") as error:
        request = {
            "words": list(map(str, words)),
            "folder": str(folder or Path.cwd()),
            "environment": dict(os.environ if environment is None else environment),
            "umask": umask,
            "stdout": out.name,
            "stderr": error.name,
        }
        status = _ask(request)
        return subprocess.CompletedProcess(request["words"], status, out.read(), error.read())


def fpg(*words: Any, **where: Any) -> subprocess.CompletedProcess[str]:
    """Run ``fpg-bench WORDS`` and return what comes of it; ``where``: see :func:`python`."""
    return python("-m", "fpg_bench", *words, **where)


@contextlib.contextmanager
def held_elsewhere(path: Path) -> Iterator[None]:
    """Hold a file as another process would that writes there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = path.with_name(f".{path.name}.lock")
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    lock.unlink()


def started(*words: Any, folder: Path, **options: Any) -> subprocess.Popen[str]:
    """Start ``fpg-bench WORDS`` in an interpreter of its own, which hears Ctrl-C also where the tests do not.

    Args:
        words: of the command line.
        folder: where it is started.
        options: others of ``subprocess.Popen``.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "fpg_bench", *words],
        cwd=folder,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )


def _ask(request: dict[str, Any]) -> int:
    server = _server()
    print(json.dumps(request), file=server.stdin, flush=True)
    return int(server.stdout.readline())


@cache
def _server() -> subprocess.Popen[str]:
    """One for all tests of this process."""
    command = [sys.executable, "-m", "tests.program_server"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    server = subprocess.Popen(command, cwd=ROOT, env=os.environ | _ONE_THREAD, text=True, **pipes)
    atexit.register(server.communicate)
    return server
