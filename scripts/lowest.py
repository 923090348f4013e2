"""Print the lowest versions that ``pyproject.toml`` allows, as constraints for pip.

``make test-lowest`` installs them and runs a small suite. What is not named stays free.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
EXTRAS = ("evaluate", "train", "video")  # what the small suite needs beside the core


def requirements(extras: tuple[str, ...] = EXTRAS) -> Iterator[Requirement]:
    """What the core and these extras ask for; extras that stand in others are left out."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [
        *project["dependencies"],
        *(line for e in extras for line in project["optional-dependencies"][e]),
    ]
    return (asked for asked in map(Requirement, lines) if asked.name != project["name"])


def lowest(asked: Requirement) -> str:
    """The constraint to a requirement's lowest version; raises ValueError where it names none."""
    for bound in asked.specifier:
        if bound.operator == ">=":
            return f"{asked.name}=={bound.version}"
    raise ValueError(f"{asked}: names no lowest version")


if __name__ == "__main__":
    print("\n".join(sorted({lowest(asked) for asked in requirements()})))
