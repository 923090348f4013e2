"""A window on the screen that shows pictures (pygame, of the extra ``video``)."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.extras import need

FRAMES_PER_SECOND = 10  # of windows and films


class Window:
    """Opens with the first picture and is closed by the user or by :meth:`close`.

    Args:
        title: of the window.
        frames_per_second: how fast pictures follow each other at most.

    Raises:
        UserError: pygame is not installed.
    """

    def __init__(self, title: str, frames_per_second: int) -> None:
        need("video", "pygame")
        import pygame

        self._pygame = pygame
        self._title, self._frames_per_second = title, frames_per_second
        self._screen: Any = None
        self.is_open = True

    def show(self, picture: np.ndarray) -> None:
        """Show a picture ``(height, width, 3)`` uint8 and wait until the next one is due."""
        pygame = self._pygame
        height, width = picture.shape[:2]
        if self._screen is None:
            self._open(width, height)
        surface = pygame.image.frombuffer(np.ascontiguousarray(picture), (width, height), "RGB")
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()
        self._clock.tick(self._frames_per_second)
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()

    def _open(self, width: int, height: int) -> None:
        pygame = self._pygame
        pygame.display.init()
        pygame.display.set_caption(self._title)
        try:
            self._screen = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise UserError(f"render_mode 'human' needs a screen: {error}") from error
        self._clock = pygame.time.Clock()

    def close(self) -> None:
        """Close the window; pictures shown after that are an error of the caller."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
        self.is_open = False
