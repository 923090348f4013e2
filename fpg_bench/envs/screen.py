"""Rendering of environments: ``rgb_array``, ``human`` or None."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import has, require_extra
from fpg_bench.common.products import load, offered
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.recording import Recording

FRAMES_PER_SECOND = 10  # of windows and videos
RENDER_MODES = {"rgb_array": ("matplotlib",), "human": ("matplotlib", "pygame")}  # and what each needs


@functools.cache  # the search for packages takes as long as the rest of an environment's creation
def offered_modes() -> tuple[str, ...]:
    """Return the render modes that the installed packages support."""
    drawn = RENDER_MODES if "picture" in offered("rendering") else {}
    return tuple(mode for mode, packages in drawn.items() if all(map(has, packages)))


class Screen:
    """Rendering of one game in an environment's render mode.

    Args:
        batch: the games; the first one is shown.
        mode: None (nothing is recorded), ``rgb_array`` or ``human``.

    Raises:
        UserError: another mode, or the extra ``video`` is not installed.
    """

    _recording: Recording | None = None
    _picture: Any = None
    _window: Window | None = None

    def __init__(self, batch: GameBatch, mode: str | None) -> None:
        if mode is not None and mode not in RENDER_MODES:
            raise UserError(f"render_mode: expected None, 'rgb_array' or 'human', got {mode!r}")
        if mode is not None:
            require_extra("video", *RENDER_MODES[mode])
        self._batch, self._mode = batch, mode

    def record(self, begin: bool = False) -> None:
        """Record the current step, after a reset (``begin``) and after each step."""
        if self._mode is None:
            return
        if begin or self._recording is None:
            self._recording, self._picture = Recording(self._batch), None
        else:
            self._recording.add()
        if self._mode == "human" and (self._window is None or self._window.is_open):
            picture = self._draw(self._recording)
            self._window = self._window or Window(*picture.shape[1::-1])
            self._window.show(picture)

    def picture(self) -> np.ndarray | None:
        """Return the current step, ``(640, 1120, 3)`` uint8, in mode ``rgb_array``; otherwise None."""
        return self._draw(self._recording) if self._mode == "rgb_array" and self._recording else None

    def _draw(self, recording: Recording) -> np.ndarray:
        if self._picture is None:
            self._picture = load("rendering", "picture")(recording)
        picture: np.ndarray = self._picture.draw()
        return picture

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
        self._recording = self._picture = self._window = None


class Window:
    """A window for pictures; the user or :meth:`close` closes it.

    Args:
        width, height: size of the pictures.

    Raises:
        UserError: there is no screen.
    """

    def __init__(self, width: int, height: int) -> None:
        import pygame

        self._pygame = pygame
        pygame.display.init()
        pygame.display.set_caption("Frequency point game")
        try:
            self._surface = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise UserError(f"render_mode 'human' needs a screen: {error}") from error
        self._clock = pygame.time.Clock()
        self.is_open = True

    def show(self, picture: np.ndarray) -> None:
        """Show a picture ``(height, width, 3)`` uint8 and wait until the next one is due."""
        pygame = self._pygame
        height, width = picture.shape[:2]
        shown = pygame.image.frombuffer(np.ascontiguousarray(picture), (width, height), "RGB")
        self._surface.blit(shown, (0, 0))
        pygame.display.flip()
        self._clock.tick(FRAMES_PER_SECOND)
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()

    def close(self) -> None:
        """Close the window; pictures shown after that are an error of the caller."""
        if self.is_open:
            self._pygame.display.quit()
            self.is_open = False
