"""A Python that has imported everything once, and becomes a program as often as it is asked to.

A request is a line of JSON. A fork of this process then does what ``python WORDS`` would, in a folder, with
an environment and with files of its own; the answer is its status. Nothing here may start a thread, as a
fork takes none along.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib.util
import io
import json
import os
import runpy
import sys
import threading
import traceback
import types
import weakref
from typing import Any

HEAVY = (
    "fpg_bench.cli.main",
    "fpg_bench.products.planning.search",
    "fpg_bench.products.leaderboard.verification",
    "fpg_bench.products.papers.yang_2026.experiment",
    "fpg_bench.products.league.best_responses",
    "cmaes",
    "matplotlib.pyplot",
    "onnxruntime",
    "openai",
    "scipy.stats",
)


def warm() -> None:
    """Import what programs use, and what the first model of a process imports; load the compiled game.

    An extra's library may be missing: a program that needs it will say so. A command is run as well, for
    what typer makes of words.
    """
    import torch
    import tqdm
    import typer.main

    torch.set_num_threads(1)
    tqdm.tqdm.monitor_interval = 0  # else it starts a thread
    for name in HEAVY:
        if importlib.util.find_spec(name.partition(".")[0]) is not None:
            importlib.import_module(name)
    from stable_baselines3 import PPO

    import fpg_bench

    games = fpg_bench.make_sb3("FPG/AllyVsScripted-v0", n_envs=2, seed=0)
    games.reset()
    PPO("MlpPolicy", games, device="cpu")
    from fpg_bench.cli.main import app

    typer.main.get_command = functools.cache(typer.main.get_command)  # builds all verbs anew for each command
    with contextlib.redirect_stdout(io.StringIO()):
        app(["suites"], standalone_mode=False)
    list(typer.main.get_command(app).commands.values())  # imports the others
    for each in weakref.finalize._registry:  # what is imported is not put away
        each.atexit = False
    assert threading.active_count() == 1


def become(request: dict[str, Any]) -> None:
    """Put on the folder, environment and files of a program."""
    for number, name in enumerate((os.devnull, request["stdout"], request["stderr"])):
        file = os.open(name, os.O_RDWR)
        os.dup2(file, number)
        os.close(file)
    sys.stdin = open(0)  # noqa: SIM115
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    os.umask(request["umask"])
    sys.modules["fpg_bench.common.files"]._UMASK = request["umask"]  # which it reads when it is imported


def run(words: list[str]) -> None:
    """Do what ``python WORDS`` does."""
    kind, *rest = words
    if kind == "-m":
        sys.path.insert(0, os.getcwd())
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif kind == "-c":
        sys.path.insert(0, "")
        sys.argv = ["-c", *rest[1:]]
        main = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(rest[0], "<string>", "exec"), main.__dict__)
    else:
        sys.path.insert(0, os.path.dirname(os.path.realpath(kind)))
        sys.argv = words
        runpy.run_path(kind, run_name="__main__")


def status_of(words: list[str]) -> int:
    """Run a program to its end; gives its status."""
    try:
        run(words)
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
            return 1
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def live(request: dict[str, Any]) -> None:
    """Be a program, and leave without the second that Python takes to put away what it has imported."""
    become(request)
    status = status_of(request["words"])
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def serve() -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    gc.freeze()
    for line in sys.stdin:
        program = os.fork()
        if not program:
            live(json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(program, 0)[1]), file=answers, flush=True)
    os._exit(0)


if __name__ == "__main__":
    warm()
    sys.path.pop(0)  # this repository, which a program must find by itself
    serve()
