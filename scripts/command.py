"""Command line of a script: the parameters of its ``main`` are its options, and every error is one line."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import typer

from fpg_bench.common.errors import UserError
from fpg_bench.common.output import print_messages
from fpg_bench.common.starting import STOPPED


def run(main: Callable[..., int | None]) -> NoReturn:
    """Run ``main`` with the options of the command line; Ctrl-C and a plain kill stop it alike."""
    script = sys.modules["__main__"]
    name, about = Path(sys.argv[0]).stem, (script.__doc__ or "").splitlines()[0]
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(help=about)(main)
    for number in (signal.SIGINT, signal.SIGTERM):  # background shells ignore Ctrl-C
        signal.signal(number, signal.default_int_handler)
    print_messages()
    try:
        status = app(prog_name=name, standalone_mode=False)
    except (UserError, typer.TyperException) as error:
        sys.exit(f"{name}: {getattr(error, 'format_message', error.__str__)()}")
    sys.exit(f"{name}: stopped; finished work is kept" if status == STOPPED else status)
