"""Print the lowest versions that ``pyproject.toml`` allows, as pip constraints for ``make test-lowest``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
EXTRAS = ("evaluate", "train", "video")  # needed by the tests of ``make test-lowest``


def requirements() -> Iterator[Requirement]:
    """Yield the requirements of the core and of these extras, without extras that include others."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"]]
    for extra in EXTRAS:
        lines += project["optional-dependencies"][extra]
    return (each for each in map(Requirement, lines) if each.name != project["name"])


def lowest(requirement: Requirement) -> str:
    """Return the constraint to the lowest version; raises ValueError if the requirement has none."""
    for bound in requirement.specifier:
        if bound.operator == ">=":
            return f"{requirement.name}=={bound.version}"
    raise ValueError(f"{requirement}: has no lowest version")


if __name__ == "__main__":
    print("\n".join(sorted(set(map(lowest, requirements())))))
