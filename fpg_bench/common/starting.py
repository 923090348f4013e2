"""The command line while it starts: what was typed, and Ctrl-C while modules are still imported."""

import os
import shlex
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

STOPPED = 130
COMMAND = "FPG_BENCH_COMMAND"  # in the environment of the command line, and of its workers


def keep_command(words: Sequence[str]) -> None:
    """Keep the command for what it makes; of an absolute ``--out`` the name, as agents are published."""
    kept = ["fpg-bench", *words]
    for place, word in enumerate(words):
        if words[place - 1 : place] == ["--out"] and Path(word).is_absolute():
            kept[place + 1] = Path(word).name
    os.environ[COMMAND] = shlex.join(kept)


def stop_in_one_line() -> None:
    """Make Ctrl-C one line and a status, if this process is the command line; nothing is begun yet."""
    module = sys.orig_argv[1:3] == ["-m", "fpg_bench"]
    if (module or Path(sys.argv[0]).stem == "fpg-bench") and (
        signal.getsignal(signal.SIGINT) == signal.default_int_handler
    ):
        signal.signal(signal.SIGINT, stopped)


def stopped(number: int, frame: object) -> None:
    """Say so and end the process; an exception could be swallowed by an import."""
    os.write(2, b"fpg-bench: stopped\n")
    os._exit(STOPPED)
