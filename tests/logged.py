"""Log messages of the package, as tests read them."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator


class _ListHandler(logging.Handler):
    def __init__(self, messages: list[str]) -> None:
        super().__init__()
        self._messages = messages

    def emit(self, record: logging.LogRecord) -> None:
        self._messages.append(self.format(record))


@contextlib.contextmanager
def logged() -> Iterator[list[str]]:
    """Collect the package's messages from INFO on within the block."""
    messages: list[str] = []
    package, handler = logging.getLogger("fpg_bench"), _ListHandler(messages)
    before = package.level
    package.addHandler(handler)
    package.setLevel(logging.INFO)
    try:
        yield messages
    finally:
        package.removeHandler(handler)
        package.setLevel(before)
