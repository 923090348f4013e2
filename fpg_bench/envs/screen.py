"""Rendering of environments: ``rgb_array`` or None; ``gymnasium.make`` shows it in a window for ``human``."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import has, require_extra
from fpg_bench.common.products import load, offered
from fpg_bench.game.batch import GameBatch

FRAMES_PER_SECOND = 10  # of windows and videos
RENDER_MODES = ("rgb_array",)


@functools.cache  # the search for packages takes as long as the rest of an environment's creation
def offered_modes() -> tuple[str, ...]:
    """Return the render modes that the installed packages support."""
    return RENDER_MODES if "picture" in offered("rendering") and has("matplotlib") else ()


class Screen:
    """Rendering of one game in an environment's render mode.

    Args:
        batch: the games; the first one is shown.
        mode: None (nothing is recorded) or ``rgb_array``.

    Raises:
        UserError: another mode, or the extra ``video`` is not installed.
    """

    _recording: Any = None
    _picture: Any = None

    def __init__(self, batch: GameBatch, mode: str | None) -> None:
        if mode is not None and mode not in RENDER_MODES:
            raise UserError(f"render_mode: expected None or 'rgb_array', got {mode!r}")
        if mode is not None:
            require_extra("video", "matplotlib")
        self._batch, self._mode = batch, mode

    def record(self, begin: bool = False) -> None:
        """Record the current step, after a reset (``begin``) and after each step."""
        if self._mode is None:
            return
        if begin or self._recording is None:
            self._recording, self._picture = load("rendering", "recording")(self._batch), None
        else:
            self._recording.add()

    def picture(self) -> np.ndarray | None:
        """Return the current step, ``(640, 1120, 3)`` uint8, in mode ``rgb_array``; otherwise None."""
        if self._recording is None:
            return None
        if self._picture is None:
            self._picture = load("rendering", "picture")(self._recording)
        picture: np.ndarray = self._picture.draw()
        return picture

    def close(self) -> None:
        """Forget the recording."""
        self._recording = self._picture = None
