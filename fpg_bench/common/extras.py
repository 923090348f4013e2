"""The packages that only some of the suite needs: what is missing is told in one line, with its extra.

The core plays the game: views, scripts, shipped agents, ``play``. Everything else stands in an extra of
``pyproject.toml``, and whoever needs a package of one says so here before work begins.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec

from fpg_bench.common.errors import UserError


def need(extra: str, *packages: str) -> None:
    """Make sure that packages which an extra brings can be imported; none of them is loaded by this.

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
    """Whether a package can be imported; it is not loaded by this."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None
