"""Where a run of hours is: kept now and then, so that one that is killed goes on from there."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError

EVERY_S = 600.0


class Checkpoint:
    """The whole state of a run in one file, which is there whole or not at all.

    The file is a pickle: only one that this machine's own run has left in its own folder is ever read.

    Args:
        path: of the file.
        about: which run it is; a file of another one is refused.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self._path, self._about, self._last = path, dict(about), time.monotonic()

    def read(self) -> Any:
        """What was kept last; None where nothing was.

        Raises:
            UserError: the file cannot be read, or is of another run.
        """
        if not self._path.exists():
            return None
        try:
            with self._path.open("rb") as file:
                about = pickle.load(file)
                state = pickle.load(file) if about == self._about else None
        except Exception as error:  # pickle raises many kinds
            said = " ".join(str(error).split()) or type(error).__name__
            raise UserError(f"checkpoint {self._path}: cannot be read ({said}); {_REMOVE}") from error
        if about != self._about:
            raise UserError(f"checkpoint {self._path}: is of another run ({about}); {_REMOVE}")
        return state

    def keep(self, state: Any) -> None:
        """Write it, if ten minutes have passed since."""
        if time.monotonic() - self._last < EVERY_S:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self._path.with_name(f".{self._path.name}")
        with unfinished.open("wb") as file:
            for part in (self._about, state):
                pickle.dump(part, file, protocol=5)
        os.replace(unfinished, self._path)
        self._last = time.monotonic()

    def remove(self) -> None:
        """Remove the file: the run has come to its end."""
        self._path.unlink(missing_ok=True)


_REMOVE = "remove it, and the run begins again"
