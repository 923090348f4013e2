"""Where a run of hours is: kept now and then, so that one that is killed goes on from there.

What is kept is a pickle. It lies in the user's own cache, as compiled code does, never in a folder that can
come from elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import time
from collections.abc import Mapping
from typing import Any

import platformdirs

from fpg_bench.common.errors import UserError

EVERY_S = 600.0


class Checkpoint:
    """The whole state of a run in one file, which is there whole or not at all.

    Args:
        about: which run it is, in words that JSON knows; the file is named by them.
    """

    def __init__(self, about: Mapping[str, Any]) -> None:
        name = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:24]
        self._path = platformdirs.user_cache_path("fpg_bench") / "reproduce" / f"{name}.checkpoint"
        self._last = time.monotonic()

    def read(self) -> Any:
        """What was kept last; None where nothing was.

        Raises:
            UserError: the file cannot be read.
        """
        if not self._path.exists():
            return None
        try:
            return pickle.loads(self._path.read_bytes())
        except Exception as error:  # pickle raises many kinds
            said = " ".join(str(error).split()) or type(error).__name__
            raise UserError(
                f"checkpoint {self._path}: cannot be read ({said}); remove it, and the run begins again"
            ) from error

    def keep(self, state: Any, now: bool = False) -> None:
        """Write it, if ten minutes have passed since, or ``now``."""
        if not now and time.monotonic() - self._last < EVERY_S:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        unfinished = self._path.with_name(f".{self._path.name}")
        with unfinished.open("wb") as file:
            pickle.dump(state, file, protocol=5)
        os.replace(unfinished, self._path)
        self._last = time.monotonic()

    def remove(self) -> None:
        """Remove the file: what the run came to lies elsewhere."""
        self._path.unlink(missing_ok=True)
