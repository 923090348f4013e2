"""Optional dependencies: a missing package is one clear line that names its extra.

The core plays the game: environments, scripts, shipped agents, ``play``. Everything else is in an extra of
``pyproject.toml``; code that needs a package of an extra calls :func:`require_extra` before its work begins.
"""

from __future__ import annotations

import contextlib
import os
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec

from fpg_bench.common.errors import UserError
from fpg_bench.common.strict_json import read_object


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
            raise UserError(f"{package} is not installed: {install_command(extra)}")


def install_command(extra: str) -> str:
    """Return the ``pip`` command that adds an extra to this installation, from where it was installed.

    That is the folder, archive or repository of PEP 610's ``direct_url.json``, else the package index.
    """
    import urllib.request  # here, as it takes longer to import than most of this package
    from urllib.parse import urlsplit

    with contextlib.suppress(PackageNotFoundError, KeyError, ValueError):
        origin = read_object(distribution("fpg-bench").read_text("direct_url.json") or "{}")
        url = urlsplit(origin["url"])
        if origin.get("dir_info", {}).get("editable"):
            return f'pip install -e "{urllib.request.url2pathname(url.path)}[{extra}]"'
        vcs = origin.get("vcs_info")
        source = f"{vcs['vcs']}+{origin['url']}@{vcs['commit_id']}" if vcs else origin["url"]
        return f'pip install "fpg-bench[{extra}] @ {source}"'
    return f'pip install "fpg-bench[{extra}]"'


def has(package: str) -> bool:
    """Return True if a package can be imported, without importing it."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


# Read by onnxruntime and huggingface_hub when they are imported, by Ray when it is started. Otherwise
# onnxruntime starts a thread, writes an id of the device into the user's cache and sends events.
NO_TELEMETRY = {"ORT_DISABLE_TELEMETRY": "1", "HF_HUB_DISABLE_TELEMETRY": "1", "RAY_USAGE_STATS_ENABLED": "0"}


def turn_off_telemetry() -> None:
    """Set the variables that turn telemetry off, in this process and in those that it starts."""
    for name, value in NO_TELEMETRY.items():
        os.environ.setdefault(name, value)
