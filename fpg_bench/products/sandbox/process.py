"""Sandboxed processes for untrusted bytes: limits and layers around them, raw bytes in and out.

Nothing from the process is ever unpickled. It starts with an environment without keys, in an empty folder,
and ends with its parent. Before it reads an untrusted byte it reports the layers that stand around it, and
ends if there are none or if it has several threads.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import NO_TELEMETRY
from fpg_bench.products.sandbox.isolation import UNPROTECTED, Layer, missing, refusal

# Environment variables that the process gets: nothing that could be a secret.
_KEPT = ("PATH", "HOME", "LANG", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
_SECRET = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
_NEEDED = "RAY_"  # a cluster's
_ONES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "MALLOC_ARENA_MAX")
LARGEST_ANSWER = 1 << 26
HELLO = struct.Struct("<III")  # the process id as seen from outside, the layers that stand, and the threads
_logger = logging.getLogger(__name__)
_AT_ONCE = 1 << 16
_LATER_S = 0.5  # by how much a time limit may be overdrawn


_MISSING: dict[str, None] = {}  # resources that processes could not be kept from


def missing_here() -> list[str]:
    """Return the resources that this machine could not keep its sandboxed processes from."""
    return list(_MISSING)


def _warn_of(lacking: list[str]) -> None:
    """Warn once of the resources that a process cannot be kept from, wherever a policy is received."""
    if not _MISSING.keys() >= set(lacking):
        _MISSING.update(dict.fromkeys(lacking))
        _logger.warning(f"this machine cannot keep policies of others from {', '.join(_MISSING)}")


class Unprotected(UserError):
    """No policy can be played on this machine, as nothing would isolate it."""


class PolicyFailed(UserError):
    """A policy's process died, exceeded its limits, or broke the contract: it cannot be verified."""


@dataclass(frozen=True)
class ProcessLimits:
    """Limits of a process; those of time are generous, as no score depends on a clock.

    Attributes:
        memory_bytes: address space, the interpreter and its libraries included.
        start_s: seconds until the policy is loaded.
        call_s, row_s: seconds for one answer, and for each game in it.
        total_s: seconds for all answers together.
    """

    memory_bytes: int = 2 * 2**30
    start_s: float = 120.0
    call_s: float = 10.0
    row_s: float = 0.02
    total_s: float = 1200.0


class Sandbox:
    """Running sandboxed process of a module of this package, and the socket to it.

    Args:
        module: its ``main`` takes a :class:`fpg_bench.products.sandbox.child.SandboxChild` and locks it down.
        limits: of memory and time.
    """

    def __init__(self, module: str, limits: ProcessLimits) -> None:
        if not hasattr(os, "fork"):
            raise UserError("an agent of others runs in a sandbox, which needs Linux; on Windows, use WSL")
        self.limits = limits
        self._left_s = limits.total_s
        self._folder = tempfile.TemporaryDirectory(prefix="fpg-bench-")
        self._socket, theirs = socket.socketpair()
        self._reader, self._timeout = MessageReader(self._socket), 0.0
        self._hello: tuple[int, Layer] | None = None
        cpu_s = int(limits.start_s + limits.total_s) + 1
        numbers = map(str, (theirs.fileno(), limits.memory_bytes, cpu_s))
        command = [sys.executable, "-P", "-m", "fpg_bench.products.sandbox.child", module, *numbers]
        with theirs:
            self._process = subprocess.Popen(
                command,
                env=_environment(),
                cwd=self._folder.name,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )

    @property
    def pid(self) -> int:
        """Id of the process that reads the bytes; before its report, of the one that was started."""
        return self._process.pid if self._hello is None else self._hello[0]

    @contextlib.contextmanager
    def within(self, seconds: float) -> Iterator[None]:
        """Limit the time of sending and receiving inside the block, and count it towards the total.

        Raises:
            PolicyFailed: no answer in time, or the process has ended.
        """
        begin = time.monotonic()
        allowed = min(seconds, self._left_s)
        self._deadline = begin + allowed
        try:
            yield
        except TimeoutError:
            in_all = f"outran the {self.limits.total_s:g} s that all its answers may take"
            late = f"gave no answer within {seconds:g} s" if allowed == seconds else in_all
            raise PolicyFailed(late) from None
        except (EOFError, ConnectionError):
            raise PolicyFailed(self._ended()) from None
        finally:
            self._left_s -= time.monotonic() - begin

    def send(self, *parts: bytes | memoryview) -> None:
        """Send bytes, inside :meth:`within`."""
        self._wait()
        self._socket.sendall(b"".join(parts))

    def receive(self, count: int) -> bytes:
        """Receive exactly so many bytes, inside :meth:`within`.

        Raises:
            Unprotected: the process is not isolated, and has ended for that reason.
        """
        if count > LARGEST_ANSWER:
            raise PolicyFailed(f"answers with {count:,} bytes")
        if self._hello is None:
            outside, standing, threads = HELLO.unpack(self._reader.read(HELLO.size, self._wait))
            self._hello = outside, Layer(standing)
            if why := refusal(Layer(standing), threads):
                raise Unprotected(why)
            _warn_of(missing(Layer(standing)))
        return self._reader.read(count, self._wait)

    def close(self) -> None:
        """End the process."""
        self._socket.close()
        if self._hello is not None:  # the process that was started ends with it
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(self._hello[0], signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LATER_S)
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def _wait(self) -> None:
        """Set the socket's timeout to the deadline."""
        left = self._deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError
        if not left <= self._timeout < left + _LATER_S:  # setting it is a system call
            self._timeout = left + _LATER_S / 2
            self._socket.settimeout(self._timeout)

    def _ended(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        status = self._process.returncode
        if status is None or status >= 0:
            return f"its process ended by itself (status {status})"
        return f"its process died ({signal.Signals(-status).name})"


class MessageReader:
    """Buffered reader of a socket.

    Args:
        connection: the socket.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._have = b""

    def read(self, count: int, before: Callable[[], None] = lambda: None) -> bytes:
        """Read exactly so many bytes; ``before`` is called before each wait.

        Raises:
            EOFError: the other end is closed.
        """
        while len(self._have) < count:
            before()
            found = self._socket.recv(max(_AT_ONCE, count - len(self._have)))
            if not found:
                raise EOFError
            self._have += found
        data, self._have = self._have[:count], self._have[count:]
        return data


def forget_keys() -> list[str]:
    """Remove keys from this process's environment, and return their names.

    ``/proc/<pid>/environ`` shows the environment that a process was started with even after a variable was
    deleted, so that memory is overwritten as well.
    """
    names = [name for name in os.environ if _SECRET.search(name) and not name.startswith(_NEEDED)]
    for name in names:
        _overwrite(name)
        del os.environ[name]
    return names


def _overwrite(name: str) -> None:
    library = ctypes.CDLL(None)
    library.getenv.restype = ctypes.c_void_p
    place = library.getenv(os.fsencode(name))
    if place:
        ctypes.memset(place, 0, len(os.fsencode(os.environ[name])))


def _environment() -> dict[str, str]:
    kept = {name: os.environ[name] for name in (*_KEPT, UNPROTECTED) if name in os.environ}
    return (
        kept
        | NO_TELEMETRY
        | dict.fromkeys(_ONES, "1")
        | {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    )
