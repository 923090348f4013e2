"""Jobs for tests, which leave a line or a file in a folder for everything that happens to them."""

import os
import signal
import time
import weakref


def note(folder, name):
    with (folder / "begun").open("a") as file:
        file.write(f"{name}\n")


def begun(folder):
    """Return the names of the jobs that began, once for each time."""
    file = folder / "begun"
    return sorted(file.read_text().split()) if file.exists() else []


def square(folder, number):
    note(folder, number)
    return number * number


def threads():
    import torch

    return torch.get_num_threads()


def fail(error):
    raise error


def die(folder, name, times):
    """Kill the worker, so many times."""
    note(folder, name)
    if begun(folder).count(name) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return name


def hold(folder, name):
    """Run until the file ``go`` exists; save a file when interrupted."""
    note(folder, name)
    try:
        while not (folder / "go").exists():
            time.sleep(0.02)
    except KeyboardInterrupt:
        (folder / f"saved_{name}").touch()
        raise
    (folder / f"finished_{name}").touch()
    return name


def hold_in_callback(folder, name):
    """Run as :func:`hold`, after a callback that swallows the first interrupt."""
    thing: set[str] = set()
    reference = weakref.ref(thing, lambda _: hold(folder, name))
    del thing
    assert reference() is None
    hold(folder, name)


def fail_import(folder, name):
    """Run until interrupted; fail as a module in C does whose import is interrupted."""
    try:
        hold(folder, name)
    except KeyboardInterrupt as error:
        raise ImportError("numpy.core.multiarray failed to import") from error


def fill(content, folder):
    """Fill a folder, which may not exist."""
    (folder / "agent").mkdir(parents=True, exist_ok=True)
    (folder / "agent" / "policy").write_bytes(content)


def fill_elsewhere(folder):
    """Write nothing where this machine could see it."""


def wait_for(condition, seconds=400):  # far longer than it takes on a busy machine
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)
