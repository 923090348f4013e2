"""The command line while it starts: what was typed, and Ctrl-C while modules are still imported."""

import os
import shlex
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

STOPPED = 130
WRITTEN = ("--out", "--work")  # folders; agents are published, and name none of a machine
COMMAND = "FPG_BENCH_COMMAND"  # in the environment of the command line, and of its workers


def keep_command(words: Sequence[str]) -> None:
    """Keep the command for what it makes; of the absolute folders that it writes the names."""
    kept = ["fpg-bench"]
    for before, word in zip(["", *words], words, strict=False):
        option, _, path = word.partition("=") if word.startswith("--") else (before, "", word)
        is_written = option in WRITTEN and Path(path).is_absolute()
        kept.append(word.removesuffix(path) + Path(path).name if is_written else word)
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
