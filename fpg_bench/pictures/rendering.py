"""Rendering an arena's game: its recording, the picture of it, and the window that shows it."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.arena import Arena
from fpg_bench.pictures.picture import Picture
from fpg_bench.pictures.recording import Recording
from fpg_bench.pictures.window import FRAMES_PER_SECOND, Window


class Renderer:
    """Follows one game of an arena and draws it; the views of one game own one each.

    Args:
        arena: the games.
        human: whether :meth:`show` will be called; then pygame must be there.
        game: which game is followed.

    Raises:
        UserError: ``human`` without pygame.
    """

    def __init__(self, arena: Arena, human: bool = False, game: int = 0) -> None:
        self._arena, self._game = arena, game
        self._window = Window("Frequency point game", FRAMES_PER_SECOND) if human else None
        self._recording: Recording | None = None
        self._picture: Picture | None = None

    def record(self, begin: bool = False) -> None:
        """Take in a reset (``begin``) or a step that the arena has just played."""
        if begin or self._recording is None:
            self._recording = Recording(self._arena, self._game)
            self._picture = None
        else:
            self._recording.add()

    def draw(self) -> np.ndarray:
        """The picture of the round so far, ``(640, 1120, 3)`` uint8, the caller's own."""
        if self._recording is None:
            self.record(begin=True)
        if self._picture is None:
            self._picture = Picture(self._recording)  # type: ignore[arg-type]
        return self._picture.draw()

    def show(self) -> None:
        """Show the picture in the window, at ten steps a second; nothing once the user closed it."""
        if self._window is not None and self._window.is_open:
            self._window.show(self.draw())

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
