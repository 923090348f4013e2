"""Environments with the wheel and nothing but what it asks for, made of the packages that are installed here.

No registry is asked. The requirements are read from the wheel itself, those of each package from its own
metadata, and only what follows from them can be imported.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
import venv
from collections.abc import Iterable, Iterator
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


def install_wheel(folder: Path) -> Path:
    """Build this repository's sdist, and the wheel from it, and unpack that; gives the package's folder."""
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    target = ["--target", str(folder / "site"), str(wheel)]
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile", *target]
    subprocess.run(install, check=True, capture_output=True)
    return folder / "site"


def environment(folder: Path, wheel: Path, extras: Iterable[str] = ()) -> Path:
    """An environment in which the wheel stands with these extras; gives its Python."""
    venv.create(folder, with_pip=False, symlinks=True)
    site = next((folder / "lib").glob("python3*")) / "site-packages"
    for name in os.listdir(wheel):
        (site / name).symlink_to(wheel / name)
    for package in needed(wheel, extras):
        for name in {path.parts[0] for path in package.files or () if path.parts[0] != ".."}:
            if not (site / name).exists():
                (site / name).symlink_to(package.locate_file(name))
    return folder / "bin" / "python"


def needed(wheel: Path, extras: Iterable[str] = ()) -> list[importlib.metadata.Distribution]:
    """All packages that the wheel needs with these extras, and what those need in turn."""
    found: dict[str, importlib.metadata.Distribution] = {}
    waiting = [("fpg-bench", frozenset(extras))]
    done = set()
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in done:
            continue
        done.add((name, wanted))
        if name == "fpg-bench":
            (package,) = importlib.metadata.distributions(name=name, path=[str(wheel)])
        else:
            package = found[name] = importlib.metadata.distribution(name)
        waiting += _asked(package, wanted)
    return list(found.values())


def _asked(
    package: importlib.metadata.Distribution, extras: frozenset[str]
) -> Iterator[tuple[str, frozenset[str]]]:
    """Return the packages that a package with these extras asks for, and the extras of each."""
    for line in package.requires or ():
        asked = Requirement(line)
        if asked.marker is None or any(asked.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield re.sub(r"[-_.]+", "-", asked.name).lower(), frozenset(asked.extras)


def run(python: Path, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run Python in an environment, with nothing told to it but by these words."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "FPG_"))}
    return subprocess.run(
        [str(python), *words], cwd=cwd, env=kept, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
