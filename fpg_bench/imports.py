"""Objects of the user's own code, named ``package.module:object``."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Sequence
from typing import Any

from fpg_bench.errors import UserError


def import_object(name: str, what: str, methods: Sequence[str], scenario: Any) -> Any:
    """The object that ``package.module:object`` names, the present folder included.

    A class or function is called first to make it, told the scenario if it takes an argument.

    Args:
        name: ``package.module:object``.
        what: what it should be; begins the message of an error.
        methods: it must have one of these.
        scenario: what is played.

    Raises:
        UserError: no such module or object, or one without any of the methods.
    """
    module, _, attribute = name.partition(":")
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UserError(f"{what} {name!r}: {error}") from error
    if isinstance(found, type) or not has_any(found, methods):
        found = made(found, scenario) if callable(found) else found
    if not has_any(found, methods):
        raise UserError(f"{what} {name!r}: has no {' or '.join(methods)}")
    return found


def has_any(thing: Any, methods: Sequence[str]) -> bool:
    """Whether an object has at least one of the methods."""
    return any(callable(getattr(thing, method, None)) for method in methods)


def made(maker: Any, scenario: Any) -> Any:
    """What a class or function makes, told the scenario if it takes an argument."""
    return maker(scenario) if inspect.signature(maker).parameters else maker()
