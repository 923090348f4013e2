"""What the jobs of the tests do: they leave a line or a file in a folder for all that happens to them."""

import contextlib
import os
import signal
import time

from fpg_bench.common.errors import UserError


def note(folder, name):
    with (folder / "begun").open("a") as file:
        file.write(f"{name}\n")


def begun(folder):
    """The names of the jobs that began, once for each time."""
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
    """Take the worker along, so many times."""
    note(folder, name)
    if begun(folder).count(name) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return name


def hold(folder, name):
    """Run until the file ``go`` is there; what is stopped says so."""
    note(folder, name)
    try:
        while not (folder / "go").exists():
            time.sleep(0.02)
    except KeyboardInterrupt:
        (folder / f"saved_{name}").touch()
        raise
    (folder / f"finished_{name}").touch()
    return name


def finish(folder, name):
    """Run until Ctrl-C comes, which is just too late."""
    with contextlib.suppress(KeyboardInterrupt):
        hold(folder, name)
    return name


def fill(content, folder):
    """Fill a folder, unless told to fail in the middle."""
    (folder / "agent").mkdir(parents=True, exist_ok=True)
    (folder / "agent" / "policy").write_bytes(content)
    if content == b"bad":
        raise UserError("out of luck")
    (folder / "run.json").write_text("{}")


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)
