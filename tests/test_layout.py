"""Layout of the package: imports one way, a light front door, rules that are written down."""

from __future__ import annotations

import ast
import dataclasses
import graphlib
import io
import subprocess
import sys
import tokenize
from functools import cache
from pathlib import Path

import pytest

import fpg_bench
from fpg_bench.common.ids import ENVS, action_modes, id_with
from fpg_bench.game.scenario import Scenario

PACKAGE = Path(fpg_bench.__file__).parent
DOCS = PACKAGE.parent / "docs"

# What a room may import lies on a lower floor, or on its own, where only one of the two imports the other.
FLOORS = {
    "version": 0,
    "common": 0,
    "game": 1,
    "players": 2,
    "envs": 3,
    "evaluation": 4,
    "training": 5,
    "cli": 6,
    "products": 7,
}
# Lines of the core, and of all, with a slack that bothers nobody; they go down by what goes
MOST_CODE, MOST_IN_ALL, SLACK = 11_560, 28_560, 200
HEAVY = ("numba", "torch", "stable_baselines3", "matplotlib", "onnxruntime")


def module_of(path: Path) -> str:
    """The name by which a file of the package is imported."""
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


FILES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imported(source: str) -> set[str]:
    """The modules of the package that a source imports, in functions and for types alone, too."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports inside the package are absolute"
            named = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in FILES else node.module or "" for name in named}
    return found & set(FILES)


@cache
def graph() -> dict[str, set[str]]:
    """The modules that each module of the package imports."""
    return {module: imported(path.read_text(encoding="utf-8")) - {module} for module, path in FILES.items()}


def room_of(module: str) -> str:
    """The part of the package in which a module lies, of a product its folder; nothing for the front door."""
    parts = module.split(".")
    return ".".join(parts[1 : 3 if parts[1:2] == ["products"] else 2])


def floor_of(module: str) -> int | None:
    """The floor of a module's room; None for the front door."""
    return FLOORS.get(room_of(module).partition(".")[0])


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a ring, as the sorter tells them; none where all is in order."""
    try:
        tuple(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def test_every_room_has_a_floor_and_a_line_in_the_map():
    assert {room_of(module).partition(".")[0] for module in FILES} - {"", "__main__"} == set(FLOORS)
    tree = (DOCS / "project/map.md").read_text(encoding="utf-8")
    assert not [room for room in FLOORS if f"{room}/" not in tree.split() and room != "version"]


def test_imports_run_one_way():
    wrong = [
        f"{module} imports {other}"
        for module, others in graph().items()
        if (room := floor_of(module)) is not None
        for other in others
        if (floor_of(other) or 0) > room or other == "fpg_bench"  # the front door lies above all of them
    ]
    assert not wrong


def test_no_modules_and_no_rooms_import_each_other_in_a_circle():
    assert not circle(graph())
    rooms: dict[str, set[str]] = {}
    for module, others in graph().items():
        rooms.setdefault(room_of(module), set()).update(map(room_of, others))
    assert not circle({room: others - {room} for room, others in rooms.items()})


def code_lines(source: str) -> int:
    """Count the lines of a source without comments, docstrings, imports and empty lines."""
    others: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        is_text = isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)
        if is_text or isinstance(node, ast.Import | ast.ImportFrom):
            others.update(range(node.lineno, (node.end_lineno or 0) + 1))
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    spans = [
        range(each.start[0], each.end[0] + 1) for each in tokens if each.string.strip()[:1] not in ("", "#")
    ]
    return len(set().union(*spans) - others)


def test_lines_of_code_are_counted_without_what_is_written_beside_them():
    assert code_lines('"""Words."""\n\nimport io\n\n# More.\nx = """a\nb"""\ndef f():\n    """Do."""\n') == 3


def test_there_is_no_more_code_than_was_decided():
    lines = {module: code_lines(path.read_text(encoding="utf-8")) for module, path in FILES.items()}
    core = {module for module in lines if not room_of(module).startswith("products")}
    assert sum(lines[module] for module in core) <= MOST_CODE + SLACK
    assert sum(lines.values()) <= MOST_IN_ALL + SLACK


def test_a_public_class_name_stands_for_one_thing():
    homes: dict[str, list[str]] = {}
    for module, path in FILES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(module)
    assert not {name: modules for name, modules in homes.items() if len(modules) > 1}


def test_the_board_never_reads_the_records_of_the_zoo():
    """It ranks by rounds that it has played itself."""
    readers = [module for module, others in graph().items() if "fpg_bench.products.zoo.zoo" in others]
    assert readers
    assert not [module for module in readers if room_of(module) == "products.leaderboard"]


@pytest.mark.parametrize(
    ("door", "home"),
    [
        ("numba.core", "game/compiling.py"),
        ("._trial_id", "products/tuning/worker.py"),
        ("._setup_learn", "products/maddpg/maddpg.py"),
    ],
)
def test_a_private_door_of_another_package_is_opened_in_one_place(door, home):
    """Code without a public name may go with any release; then one file has to change."""
    found = [str(path.relative_to(PACKAGE)) for path in FILES.values() if door in path.read_text("utf-8")]
    assert found == [home]


def test_the_private_doors_are_still_there():
    """Tells which one an upgrade has closed."""
    import optuna
    from numba.core import event
    from stable_baselines3.common.base_class import BaseAlgorithm

    assert callable(event.register)
    assert callable(BaseAlgorithm._setup_learn)
    trial = optuna.create_study().ask()
    assert isinstance(trial._trial_id, int)


def test_the_rules_know_no_learning_library():
    known = {"numpy", "numba", "yaml", "platformdirs", "fpg_bench", "__future__", *sys.stdlib_module_names}
    for path in (PACKAGE / "game").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= known, path


@pytest.mark.process
def test_importing_the_package_registers_the_ids_and_loads_nothing_heavy():
    code = "import sys, gymnasium, fpg_bench; print(*sys.modules, *gymnasium.registry)"
    loaded = set(subprocess.check_output([sys.executable, "-c", code], text=True).split())
    ids = {id_with(name, mode) for name, of in ENVS.items() for mode in action_modes(of.side)}
    assert {name for name in loaded if name.startswith("FPG/")} == ids
    assert loaded.isdisjoint(HEAVY)


@pytest.mark.process
def test_the_process_of_a_submitted_policy_loads_no_more_than_it_plays_with():
    code = "import sys, fpg_bench.products.sandbox.policy; print(*sys.modules)"
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True).split()
    assert set(loaded).isdisjoint(
        {*HEAVY, "fpg_bench.products.leaderboard.submission", "fpg_bench.products.planning"}
    )


def test_the_rules_and_the_page_of_link_document_every_field():
    pages = ("reference/rules.md", "reference/link.md")
    text = "".join((DOCS / page).read_text(encoding="utf-8") for page in pages)
    assert [spec.name for spec in dataclasses.fields(Scenario) if f"`{spec.name}`" not in text] == []


def test_the_measures_are_all_documented():
    import numpy as np

    from fpg_bench.game.metrics import measures
    from fpg_bench.game.state import TALLY

    names = measures(dict.fromkeys(TALLY.names, 0), np.zeros((2, 3)))
    text = (DOCS / "reference/measures.md").read_text(encoding="utf-8")
    assert not [name for name in names if f"`{name}`" not in text]


def test_the_front_door_shows_the_public_names_alone():
    assert dir(fpg_bench) == sorted(fpg_bench.__all__)
    assert all(hasattr(fpg_bench, name) for name in dir(fpg_bench))
