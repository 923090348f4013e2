"""How a check fails: an ``AssertionError`` of one line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from fpg_bench.errors import UserError


def require(holds: Any, message: str) -> None:
    """Fail with a message where something does not hold."""
    if not holds:
        raise AssertionError(message)


@contextlib.contextmanager
def asserting() -> Iterator[None]:
    """What the package refuses in play is a check that fails here."""
    try:
        yield
    except UserError as error:
        raise AssertionError(str(error)) from error
