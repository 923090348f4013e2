"""How the package hangs together: imports one way, a light front door, rules that are written down."""

from __future__ import annotations

import ast
import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest

import fpg_bench
from fpg_bench.game.scenario import Scenario

PACKAGE = Path(fpg_bench.__file__).parent
DOCS = PACKAGE.parent / "docs"

# What a part may import lies on a lower floor; parts on one floor may not import each other both ways.
FLOORS = {
    "errors": 0,
    "files": 0,
    "ids": 0,
    "imports": 0,
    "plain_json": 0,
    "rows": 0,
    "jobs": 1,
    "game": 1,
    "players": 2,
    "planning": 2,
    "envs": 3,
    "evaluation": 4,
    "training": 5,
    "leaderboard": 5,
    "reproduce": 5,
    "seasons": 5,
    "testing": 5,
    "cli": 6,
}
HEAVY = ("numba", "torch", "stable_baselines3", "matplotlib", "onnxruntime")


def imported_parts(source: str) -> set[str]:
    """The parts of the package that a module imports, wherever in the module it does so."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports inside the package are absolute"
            named = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= named if node.module == "fpg_bench" else {node.module or ""}
    return {name.split(".")[1] for name in found if name.startswith("fpg_bench.")}


def imports() -> set[tuple[str, str, Path]]:
    """(importing part, imported part, file), within the package; its front door is left out."""
    found = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        part = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if part in ("__init__", "__main__"):
            continue
        others = imported_parts(path.read_text(encoding="utf-8")) - {part}
        found |= {(part, other, path.relative_to(PACKAGE)) for other in others}
    return found


def test_every_part_has_a_floor():
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    packages = {path.parent.name for path in PACKAGE.glob("*/*.py")}
    assert modules | packages <= set(FLOORS)


def test_imports_run_one_way():
    wrong = [f"{path} imports {b}" for a, b, path in imports() if b in FLOORS and FLOORS[b] > FLOORS[a]]
    assert not wrong


def test_parts_of_one_floor_do_not_import_each_other():
    edges = {(a, b) for a, b, _ in imports() if FLOORS.get(a) == FLOORS.get(b)}
    assert not [(a, b) for a, b in edges if (b, a) in edges]


def test_the_rules_know_no_learning_library():
    known = {"numpy", "numba", "yaml", "platformdirs", "fpg_bench", "__future__", *sys.stdlib_module_names}
    for path in (PACKAGE / "game").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= known, path


@pytest.mark.process
def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, fpg_bench; print(*sys.modules)"
    loaded = set(subprocess.check_output([sys.executable, "-c", code], text=True).split())
    assert "gymnasium" in loaded
    assert loaded.isdisjoint(HEAVY)


@pytest.mark.process
def test_importing_the_package_registers_the_ids():
    code = "import fpg_bench, gymnasium; print(*(i for i in gymnasium.registry if i.startswith('FPG/')))"
    found = subprocess.check_output([sys.executable, "-c", code], text=True).split()
    from fpg_bench.ids import VIEWS

    assert set(found) == set(VIEWS)


@pytest.mark.parametrize("name", [spec.name for spec in dataclasses.fields(Scenario)])
def test_the_rules_document_every_field(name):
    assert f"`{name}`" in (DOCS / "rules.md").read_text(encoding="utf-8")


def test_the_measures_are_all_documented():
    import numpy as np

    from fpg_bench.game.measures import measures
    from fpg_bench.game.state import TALLY

    names = measures(dict.fromkeys(TALLY.names, 0), np.zeros((2, 3)))
    text = (DOCS / "measures.md").read_text(encoding="utf-8")
    assert not [name for name in names if f"`{name}`" not in text]
