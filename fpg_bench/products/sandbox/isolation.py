"""Isolation of this process by namespaces, an empty root, Landlock and refused system calls.

Each layer is tried by itself, since not every kernel has all of them; those that stand are reported.
"""

from __future__ import annotations

import contextlib
import ctypes
import enum
import os
import signal
import struct
import threading


class Layer(enum.IntFlag):
    """Layers around a process."""

    NAMESPACES = 1  # its own users, mounts, network, processes
    EMPTY_ROOT = 2  # a root folder that holds nothing and cannot be written
    LANDLOCK = 4  # no file is opened; no signal and no look at processes outside
    CALLS = 8  # no socket, no file, no process: the kernel refuses the calls


# Resources that are shut out, each by any one of these layers.
_SHUT_OUT = {
    "files": Layer.EMPTY_ROOT | Layer.LANDLOCK | Layer.CALLS,
    "the network": Layer.NAMESPACES | Layer.CALLS,
    "other processes": Layer.NAMESPACES | Layer.LANDLOCK | Layer.CALLS,
}

UNPROTECTED = "FPG_BENCH_UNPROTECTED"  # environment variable: play policies where no layer can be had
_NEW_USER, _NEW_REST = 0x10000000, 0x00020000 | 0x08000000 | 0x04000000 | 0x20000000 | 0x40000000
_PRIVATE, _EMPTY, _DETACH = 0x4000 | 0x40000, 0x1 | 0x2 | 0x4 | 0x8, 0x2
_NOBODY = 65534
_DEATH_SIGNAL, _NO_NEW_PRIVILEGES = 1, 38
_CREATE_RULESET, _RESTRICT_SELF = 444, 446  # of Landlock, on every kind of machine
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | 1
_ALL_THREADS = 4  # attribute of a libseccomp filter
# Allowed: memory, time, waiting, signals of its own, and the sockets and pipes that are open already.
# Everything else is refused, also calls that later kernels add.
_ALLOWED = """
brk clock_getres clock_gettime clock_nanosleep close exit exit_group fstat futex getcpu getpid getrandom
getrusage gettid gettimeofday lseek madvise membarrier mmap mprotect mremap munmap nanosleep poll ppoll
pselect6 read readv recvfrom restart_syscall rseq rt_sigaction rt_sigprocmask rt_sigreturn
sched_getaffinity sched_yield select sendto set_robust_list sigaltstack time times write writev
"""


def missing(layers: Layer) -> list[str]:
    """Return the resources that these layers do not shut out."""
    return [name for name, any_of in _SHUT_OUT.items() if not layers & any_of]


def refusal(layers: Layer, threads: int) -> str | None:
    """Return why a process must not read untrusted bytes, and what to do; None if it may.

    Args:
        layers: those that stand around it.
        threads: how many it had when they were raised, as most layers bind only the thread that raises them.
    """
    if threads != 1:
        return (
            f"a sandboxed process has {threads} threads before it is locked down, which isolates only one of "
            "them; does a sitecustomize module or LD_PRELOAD start the others?"
        )
    if not layers and not os.environ.get(UNPROTECTED):
        return (
            "this machine cannot isolate policies of others at all (no namespaces, Landlock or seccomp); use "
            f"Linux, or set {UNPROTECTED}=1 if you trust them"
        )
    return None


def count_threads() -> int:
    """Return the number of this process's threads, those of libraries included."""
    try:
        return len(os.listdir("/proc/self/task"))
    except OSError:  # no Linux
        return threading.active_count()


def close_files(but: int = -1) -> None:
    """Close all file descriptors but one and the standard three, which are ``/dev/null``."""
    for name in os.listdir("/dev/fd"):
        if int(name) > 2 and int(name) != but:
            with contextlib.suppress(OSError):  # the listing's own
                os.close(int(name))


def isolate() -> tuple[Layer, int]:
    """Move this single-threaded process into namespaces of its own, if the kernel allows them.

    A child continues as the first process of its namespace. This process waits for it and ends as it ends.

    Returns:
        The layers that stand now, and the process id as seen from outside.
    """
    if not _unshared():
        return Layer(0), os.getpid()
    reading, writing = os.pipe()
    if inner := os.fork():
        os.write(writing, struct.pack("<I", inner))
        _stand_for(inner)
    _libc().prctl(_DEATH_SIGNAL, signal.SIGKILL)
    (outside,) = struct.unpack("<I", os.read(reading, 4))
    os.close(reading)
    os.close(writing)
    return Layer.NAMESPACES, outside


def shut(layers: Layer) -> Layer:
    """Raise all other layers, once everything is loaded; return those that stand then."""
    filters = _filter_library()  # while there are files
    if layers & Layer.NAMESPACES and _empty_root():
        layers |= Layer.EMPTY_ROOT
    _drop_capabilities()
    with contextlib.suppress(OSError, AttributeError):
        _check(_libc().prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
        if _landlocked():
            layers |= Layer.LANDLOCK
        if filters is not None and _calls_refused(filters):
            layers |= Layer.CALLS
    return layers


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check(result: int) -> int:
    """Raise OSError where a call of the C library failed."""
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def _unshared() -> bool:
    """Enter namespaces of this process's own, as nobody; return whether that worked."""
    user, group = os.getuid(), os.getgid()
    try:
        _check(_libc().unshare(_NEW_USER | _NEW_REST))
    except (OSError, AttributeError):  # refused, or no Linux
        return False
    with contextlib.suppress(OSError):
        for name, text in (
            ("setgroups", "deny"),
            ("uid_map", f"{_NOBODY} {user} 1"),
            ("gid_map", f"{_NOBODY} {group} 1"),
        ):
            with open(f"/proc/self/{name}", "w") as file:
                file.write(text)
    return True


def _stand_for(inner: int) -> None:
    """Wait for the child, and end as it ends."""
    close_files()  # its socket, most of all
    _, status = os.waitpid(inner, 0)
    if os.WIFSIGNALED(status):
        with contextlib.suppress(OSError):  # SIGKILL has no other meaning
            signal.signal(os.WTERMSIG(status), signal.SIG_DFL)
        os.kill(os.getpid(), os.WTERMSIG(status))
    os._exit(os.waitstatus_to_exitcode(status))


def _empty_root() -> bool:
    """Make an empty, read-only folder the root, and detach all others; return whether that worked."""
    libc = _libc()
    here = os.fsencode(os.getcwd())
    try:
        _check(libc.mount(None, b"/", None, _PRIVATE, None))
        _check(libc.mount(b"none", here, b"tmpfs", _EMPTY, b"size=4k,mode=755"))
        os.chdir(here)
        _check(libc.pivot_root(b".", b"."))  # the old root now lies on top of the new one
        _check(libc.umount2(b".", _DETACH))
        os.chdir("/")
    except (OSError, AttributeError):
        return False
    return True


def _drop_capabilities() -> None:
    """Drop root's capabilities; without effect for other users."""
    head, none = struct.pack("<Ii", 0x20080522, 0), bytes(24)
    with contextlib.suppress(OSError, AttributeError):
        _check(_libc().capset(head, none))


def _landlocked() -> bool:
    """Deny all files, and as much else as Landlock can; return whether that worked."""
    libc = _libc()
    version = libc.syscall(_CREATE_RULESET, None, 0, 1)
    if version < 1:
        return False
    files = (1 << {1: 13, 2: 14}.get(version, 15 if version < 5 else 16)) - 1
    words = [files, *([3] if version >= 4 else []), *([3] if version >= 6 else [])]
    rules = struct.pack(f"<{len(words)}Q", *words)
    try:
        ruleset = _check(libc.syscall(_CREATE_RULESET, rules, len(rules), 0))
        _check(libc.syscall(_RESTRICT_SELF, ruleset, 0))
        os.close(ruleset)
    except OSError:
        return False
    return True


def _filter_library() -> ctypes.CDLL | None:
    """Load libseccomp, which knows the system calls' numbers on each architecture; None if it is missing."""
    try:
        return ctypes.CDLL("libseccomp.so.2")
    except OSError:
        return None


def _calls_refused(library: ctypes.CDLL) -> bool:
    """Refuse all system calls but those that computing needs; return whether that worked."""
    library.seccomp_init.restype = ctypes.c_void_p
    rules = ctypes.c_void_p(library.seccomp_init(ctypes.c_uint32(_REFUSE)))
    if not rules:
        return False
    library.seccomp_attr_set(rules, _ALL_THREADS, ctypes.c_uint32(1))
    for name in _ALLOWED.split():
        number = library.seccomp_syscall_resolve_name(name.encode())
        if number >= 0:  # this architecture has it
            library.seccomp_rule_add_array(rules, ctypes.c_uint32(_ALLOW), number, 0, None)
    loaded: int = library.seccomp_load(rules)
    library.seccomp_release(rules)
    return loaded == 0
