"""Optional dependencies: a missing package is one clear line that names its extra.

The core plays the game: environments, scripts, shipped agents, ``play``. Everything else is in an extra of
``pyproject.toml``; code that needs a package of an extra calls :func:`require_extra` before its work begins.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec

from fpg_bench.common.errors import UserError


def require_extra(extra: str, *packages: str) -> None:
    """Check that packages of an extra can be imported, without importing them.

    Args:
        extra: its name in ``pyproject.toml``.
        *packages: as they are imported.

    Raises:
        UserError: one of them is not installed; the message says what to install.
    """
    for package in packages:
        if not has(package):
            raise UserError(f'{package} is not installed: pip install "fpg-bench[{extra}]"')


def has(package: str) -> bool:
    """Return True if a package can be imported, without importing it."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None
