"""Ctrl-C while the command line is still importing its modules."""

import os
import signal
import sys
from pathlib import Path

STOPPED = 130


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
