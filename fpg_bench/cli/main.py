"""Command line: thin verbs over the library, with one line for every error."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import re
import signal
import sys
import threading
from collections import UserDict
from collections.abc import Callable
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command, get_group

from fpg_bench.cli.fields import HELP_ALL, with_fields
from fpg_bench.common.errors import UserError, bounded
from fpg_bench.common.imports import described
from fpg_bench.common.output import accept_all_letters, print_messages
from fpg_bench.common.products import load, offered
from fpg_bench.common.schema import wording
from fpg_bench.common.starting import COMMAND, STOPPED, keep_command, stopped

_display_type = TyperOption.display_type_rich


def _shown_type(option: TyperOption, ctx: Any) -> str | None:
    """Return the type in an option's line of ``--help``; a flag takes no value, so it has none."""
    return None if option.is_flag else _display_type(option, ctx)


TyperOption.display_type_rich = _shown_type  # type: ignore[method-assign, assignment]
_REMOVED = {  # verbs and options of earlier versions, and what does their work now
    "leaderboard crossplay": "leaderboard verify",
    "leaderboard serve": "leaderboard build, and open leaderboard/site/index.html",
    "plan": "evaluate --suite planner-v1, or play --planner NAME",
    "fictitious-self-play": "double-oracle or tabular-self-play",
    "evaluate --name": "NAME=PLAYER",
    "play --overwrite": "another --out",
    "hub push --benchmark": "the scores in the model card",
}


class _Verb(TyperCommand):
    """A verb whose ``--help`` leaves details to ``--help-all``, if it has many options."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, without the panels of details where ``--help-all`` shows them."""
        from fpg_bench.cli.options import DETAILS

        kept = self.params
        if any(each.name == HELP_ALL for each in kept) and not ctx.meta.get(HELP_ALL):
            self.params = [each for each in kept if getattr(each, "rich_help_panel", None) not in DETAILS]
        super().format_help(ctx, formatter)
        self.params = kept


class _Commands(UserDict[str, Any]):
    """Commands by name, imported when they are asked for: all together take longer than most of them run."""

    def __getitem__(self, name: str) -> Any:
        if self.data[name] is None:
            try:
                verb = load("verb", name)
            except UserError as error:  # of another distribution
                verb = _failing(error)
            if isinstance(verb, typer.Typer):
                self.data[name] = get_group(verb)
            else:
                (alone := typer.Typer(add_completion=False)).command(cls=_Verb)(with_fields(verb))
                self.data[name] = get_command(alone)
            self.data[name].name = name
        return self.data[name]


def _failing(error: UserError) -> Callable[[], None]:
    """Return a verb that stands for one that cannot be imported."""

    def fail() -> None:
        raise error

    fail.__doc__ = f"Not available: {error}"
    return fail


class _Group(TyperGroup):
    def __init__(self, **options: Any) -> None:
        super().__init__(
            **options | {"commands": _Commands(dict.fromkeys(offered("verb")) | options["commands"])}
        )

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names, without importing the verbs."""
        return [*self.commands]


app = typer.Typer(
    cls=_Group,
    help="Benchmark suite for the UAV frequency point game.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_NAME = "fpg-bench"
_DEBUG = False
_KEPT = "stopped; what was finished is kept"
_AGAIN_S = 0.05
_ENDED: int | None = None  # exit status after a SIGTERM
_INTERRUPTED = False  # by Ctrl-C
_DONE = False  # nothing is left to stop
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _print_version(wanted: bool) -> None:
    if wanted:
        from fpg_bench.version import __version__

        typer.echo(__version__)
        raise typer.Exit


def _print_constraints(wanted: bool) -> None:
    if wanted:
        from fpg_bench.players.agent import baselines_folder

        typer.echo(baselines_folder().parent / "constraints.txt")
        raise typer.Exit


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
    constraints: Annotated[
        bool,
        typer.Option(
            "--constraints",
            help="Print the path of the file of tested versions, for pip install -c.",
            callback=_print_constraints,
            is_eager=True,
        ),
    ] = False,
) -> None:
    global _DEBUG
    _DEBUG = debug
    print_messages()


def main() -> None:
    """Run the command line; end with one line and a non-zero status on every error."""
    global _INTERRUPTED, _DONE
    _INTERRUPTED = _DONE = False
    accept_all_letters()
    os.environ["MPLBACKEND"] = "agg"  # a notebook's own may not be installed here; nothing is shown
    atexit.register(gc.freeze)  # skips the garbage collection of hundreds of thousands of objects at the end
    signal.signal(signal.SIGTERM, _terminated)
    if hasattr(signal, "SIGALRM"):  # not on Windows
        signal.signal(signal.SIGALRM, signal.default_int_handler)
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, stopped):
        signal.signal(signal.SIGINT, _interrupted)
    sys.unraisablehook, threading.excepthook = _heard_again, _told_once
    keep_command(sys.argv[1:])
    try:
        _run()
    finally:
        _DONE = True
        del os.environ[COMMAND]
        _set_alarm(0)  # Python restores SIGALRM at its end, and the alarm would kill the process


def _run() -> None:
    try:
        if wrong := next((word for word in sys.argv if re.search("[\ud800-\udfff]", word)), None):
            raise UserError(f"{wrong}: is not valid UTF-8; choose another name")
        status = app(sys.argv[1:] or ["--help"], prog_name=_NAME, standalone_mode=False)
        if status == STOPPED:  # how typer reports Ctrl-C
            raise KeyboardInterrupt
        sys.exit(status)
    except typer.TyperException as error:  # wrong arguments
        if isinstance(error.__cause__, ValidationError):  # in pydantic's words
            error.message = wording(error.__cause__)
        message = getattr(error, "format_message", error.__str__)()
        verb = getattr(getattr(error, "ctx", None), "command_path", _NAME)
        if (instead := _instead_of(message, verb)) is not None:
            _fail(instead, 2)
        _fail(f"{message} ({verb} --help)", 2)
    except (typer.Abort, KeyboardInterrupt) as error:
        cause = error.__cause__ or error.__context__
        if isinstance(cause, EOFError):  # typer takes it for the user's own stop
            _fail(f"{described(cause)} (the traceback: fpg-bench --debug ...)", 1)
        _fail(_KEPT, _ENDED or STOPPED)
    except UserError as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        full = "; what was finished is kept" if error.errno in _FULL else ""
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}{full}", 1)
    except Exception as error:
        if _INTERRUPTED or _ENDED:  # an interrupted import of a C module raises an ImportError
            _fail(_KEPT, _ENDED or STOPPED)
        _fail(f"{described(error)} (the traceback: fpg-bench --debug ...)", 1)


def _instead_of(message: str, verb: str) -> str | None:
    """Return what to use in place of a verb or option that was removed; None if the message names neither."""
    word = re.match(r"No such (?:command|option:?) '?(--)?[\w-]+", message)
    name = f"{verb} {word[0].split()[-1].strip(chr(39))}".removeprefix(f"{_NAME} ") if word else ""
    return f"{name} was removed; use {_REMOVED[name]}" if name in _REMOVED else None


def _heard_again(swallowed: Any) -> None:
    """Raise Ctrl-C again shortly if it came within a callback, such as Numba's, which cannot raise it."""
    if swallowed.exc_type is KeyboardInterrupt:
        if not _DONE:
            _set_alarm(_AGAIN_S)
    else:
        sys.__unraisablehook__(swallowed)


def _told_once(raised: threading.ExceptHookArgs) -> None:
    """Leave an error of files in a thread, such as TensorBoard's on a full disk, to who waits for it."""
    if not issubclass(raised.exc_type, OSError):
        threading.__excepthook__(raised)


def _set_alarm(seconds: float) -> None:
    """Raise KeyboardInterrupt after so many seconds; 0: not any more."""
    if hasattr(signal, "setitimer"):  # not on Windows
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _interrupted(number: int, frame: object) -> None:
    """Handle Ctrl-C: remember it, and stop."""
    global _INTERRUPTED
    _INTERRUPTED = True
    raise KeyboardInterrupt


def _terminated(number: int, frame: object) -> None:
    """Handle SIGTERM as Ctrl-C, so that runs save their state."""
    global _ENDED
    _ENDED = 128 + number
    raise KeyboardInterrupt


def _fail(message: str, status: int) -> None:
    if _DEBUG:
        raise
    if sys.stderr is not None:  # print() would take standard output
        print("fpg-bench: " + bounded(" ".join(message.split())), file=sys.stderr)
    sys.exit(status)
