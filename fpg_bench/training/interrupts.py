"""Ctrl-C and SIGTERM as a request to stop at the next safe point."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any


class StopRequest:
    """Context manager that turns Ctrl-C and SIGTERM into a request to stop at the next safe point.

    Raised at once, an interrupt could cut off a write to a file or database, or get lost in compiled code.
    The second signal is raised at once nevertheless. Nothing is changed outside the main thread, nor for
    signals that are ignored.

    Args:
        notice: text for standard error when the first signal arrives.
        is_deferred: False raises the first signal at once, too, until this attribute is set.
    """

    def __init__(self, notice: str = "", is_deferred: bool = True) -> None:
        self.is_deferred = is_deferred
        self._notice = notice.encode()
        self._number: int | None = None
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.getsignal(number)
                if callable(handler):
                    self._handlers[number] = handler
                    signal.signal(number, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        is_first, self._number = self._number is None, number
        if is_first and self.is_deferred:
            os.write(2, self._notice)
        else:
            self._handlers[number](number, frame)

    @property
    def is_set(self) -> bool:
        """True once a signal has arrived."""
        return self._number is not None

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has arrived."""
        if self._number is not None:
            self._handlers[self._number](self._number, None)
            raise KeyboardInterrupt
