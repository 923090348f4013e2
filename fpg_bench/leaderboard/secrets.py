"""Keys in the environment: whoever plays submissions has no use for them, and forgets them first."""

from __future__ import annotations

import ctypes
import os
import re

_SECRET = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
_NEEDED = "RAY_"  # a cluster's


def forget_keys() -> list[str]:
    """Strike keys out of this process' environment, and out of what others may read of it; gives their names.

    A process shows what it was started with (``/proc/<pid>/environ``) even where a variable was taken away
    since, so that memory is written over, too.
    """
    names = [name for name in os.environ if _SECRET.search(name) and not name.startswith(_NEEDED)]
    for name in names:
        _write_over(name)
        del os.environ[name]
    return names


def _write_over(name: str) -> None:
    library = ctypes.CDLL(None)
    library.getenv.restype = ctypes.c_void_p
    place = library.getenv(os.fsencode(name))
    if place:
        ctypes.memset(place, 0, len(os.fsencode(os.environ[name])))
