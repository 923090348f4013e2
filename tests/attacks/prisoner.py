"""Program that runs inside the layers and tries to get out: it sends what it managed as JSON."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import os
import signal
import socket
import struct
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from fpg_bench.products.sandbox.isolation import _ALLOWED


def escapes(outside: int) -> dict[str, Callable[[], Any]]:
    """Ways out, each of which raises where it is shut.

    Args:
        outside: a process outside, which the way out may touch.
    """
    return {
        "read shadow": lambda: Path("/etc/shadow").read_bytes(),
        "read passwd": lambda: Path("/etc/passwd").read_bytes(),
        "list the root": lambda: os.listdir("/home") + os.listdir("/etc"),
        "read its environment": lambda: Path(f"/proc/{outside}/environ").read_bytes(),
        "read its memory": lambda: os.open(f"/proc/{outside}/mem", os.O_RDONLY),
        "signal it": lambda: os.kill(outside, signal.SIGCONT),
        "trace it": lambda: _called("ptrace", 16, outside, 0, 0),
        "write here": lambda: Path("file").write_bytes(b"x"),
        "write away": lambda: Path("/tmp/prisoner").write_bytes(b"x"),
        "connect": lambda: socket.create_connection(("127.0.0.1", int(os.environ["OPEN_PORT"])), 1),
        "send": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", 9)),
        "listen": lambda: socket.create_server(("127.0.0.1", 0)),
        "abstract socket": lambda: socket.socket(socket.AF_UNIX).connect("\0" + os.environ["OPEN_NAME"]),
        "fork": _fork,
        "run": lambda: os.execv("/bin/true", ["/bin/true"]),
        "mount": lambda: _called("mount", b"none", b"/", b"tmpfs", 0, None),
        "new users": lambda: _called("unshare", 0x10000000),
        "leave the root": lambda: os.chroot("."),
        "another name": lambda: _called("sethostname", b"x", 1),
    }


def attempted(outside: int) -> dict[str, str]:
    """Return what became of each way out: ``out``, or why not."""
    return {name: _try(way) for name, way in escapes(outside).items()}


def main(inside: Any) -> None:
    """Be locked down, then try everything."""
    parent = os.environ["PARENT"]
    library = ctypes.CDLL("libseccomp.so.2")  # while there are files
    allowed = [library.seccomp_syscall_resolve_name(name.encode()) for name in _ALLOWED.split()]
    inside.lock_down()
    data = json.dumps([attempted(int(parent)), passing_calls(allowed)]).encode()
    inside.connection.sendall(struct.pack("<I", len(data)) + data)


def passing_calls(allowed: Collection[int]) -> list[int]:
    """Return the numbers of the system calls beyond the allowed ones that are not refused."""
    call = ctypes.CDLL(None, use_errno=True).syscall
    # 335 and 336 are traps of uprobes, which the kernel answers by SIGILL before any filter.
    tried = [number for number in range(600) if number not in {335, 336, *allowed}]
    return [number for number in tried if call(number, *[-1] * 6) != -1 or ctypes.get_errno() != errno.EPERM]


def _try(way: Callable[[], Any]) -> str:
    try:
        way()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "out"


def _fork() -> None:
    child = os.fork()
    if child == 0:
        os._exit(0)
    with contextlib.suppress(OSError):
        os.waitpid(child, 0)


def _called(name: str, *words: Any) -> None:
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*words) < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
