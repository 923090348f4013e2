"""The line: the core imports no product, and plays, trains and measures where all products are deleted."""

from __future__ import annotations

import ast
import os
import pkgutil
import re
import shutil
import subprocess
import sys
from functools import cache
from importlib.util import resolve_name

import pytest

from fpg_bench.common import products
from fpg_bench.common.errors import UserError
from fpg_bench.common.products import PRODUCTS, load, offered
from tests.programs import ROOT
from tests.test_cli import VERBS
from tests.test_layout import FILES, graph

KINDS = sorted({kind for product in PRODUCTS.values() for kind in product.offers})
CORE = ("game", "envs", "players", "planning", "evaluation")  # folders of tests that are run without products
# Agents of others are played there, and the sandbox is a product.
OF_OTHERS = (
    "tests/players/test_population.py",
    "tests/players/test_agent.py::test_agents_that_do_not_fit_are_refused",
)
FAST = "not (browser or llama or postgres or process or ray or slow)"
TESTS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in (ROOT / "tests").rglob("*.py")
}
SCRIPTS = {path.stem: path for path in (ROOT / "scripts").glob("*.py")}  # which tests import, too


def owner(module):
    """The product that a module of the package, or a test of it, belongs to; None: the core."""
    within = module.partition(".")[2].replace(".", "/")
    for name, product in PRODUCTS.items():
        if any(f"{within}/".startswith(f"{path.removesuffix('.py')}/") for path in product.paths):
            return name
    return None


@cache
def crossings():
    """The imports of products from outside of them: module and imported module."""
    pairs = [(module, other) for module, others in graph().items() for other in others]
    return [(module, other) for module, other in pairs if owner(other) not in (None, owner(module))]


@cache
def needs_product(test):
    """Whether a module of tests or a script, or one that it imports, imports a product."""
    found, package = set(), test.rpartition(".")[0]
    for node in ast.walk(ast.parse((TESTS | SCRIPTS)[test].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = resolve_name("." * node.level + (node.module or ""), package)
            found |= {home, *(f"{home}.{alias.name}" for alias in node.names)}
    found |= {test, *(f"tests.{name}" for name in found)}
    return any(map(owner, found)) or any(map(needs_product, found & {*TESTS, *SCRIPTS} - {test}))


def test_the_core_imports_no_product():
    assert [pair for pair in crossings() if owner(pair[0]) is None] == []


def test_the_core_names_no_module_of_a_product():
    """Such a text would be an import in disguise."""
    named = [
        (module, node.value)
        for module, path in FILES.items()
        if owner(module) is None and module != products.__name__
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and re.fullmatch(r"fpg_bench\.[\w.:]+", str(node.value))
    ]
    assert [pair for pair in named if owner(pair[1].partition(":")[0])] == []


def test_products_say_which_products_they_need():
    needed = {name: {owner(to) for of, to in crossings() if owner(of) == name} for name in PRODUCTS}
    assert {name: set(product.needs) for name, product in PRODUCTS.items()} == needed


def test_the_map_shows_the_products_and_names_what_there_is():
    page = (ROOT / "docs/project/map.md").read_text(encoding="utf-8")
    for name, product in PRODUCTS.items():
        paths = ", ".join(f"`{path}`" for path in product.paths)
        assert f"| {name} | {paths} | {', '.join(product.needs) or '-'} |" in page
    places = re.findall(r"`((?:fpg_bench|baselines|tests)/[\w./]+)`", page)
    assert not [place for place in places if not (ROOT / place).exists()]
    rows = [line for line in page.splitlines() if line.startswith("|")]
    for row in rows:  # a name stands in the file before it
        for place, names in re.findall(r"`([\w./]+\.py)`: ((?:`\w+`(?:, )?)+)", row):
            text = (ROOT / place).read_text(encoding="utf-8")
            assert not [name for name in re.findall(r"\w+", names) if name not in text], place


@pytest.mark.parametrize("kind", KINDS)
def test_what_products_offer_is_theirs_and_is_there(kind):
    for title, product in PRODUCTS.items():
        for place in product.offers.get(kind, {}).values():
            assert owner(place.partition(":")[0]) == title
            assert callable(pkgutil.resolve_name(place))


def test_a_product_that_was_deleted_offers_nothing_and_is_named(monkeypatch, tmp_path):
    offered.cache_clear()
    with monkeypatch.context() as patched:
        patched.setattr(products, "PACKAGE", tmp_path)
        assert not any(map(offered, KINDS))
        with pytest.raises(UserError, match=r"planner 'llm': .* without language models"):
            load("planner", "llm")
        offered.cache_clear()


@pytest.fixture
def copy(tmp_path):
    """A copy of the package and its tests, which lies beside all else that they read."""
    folder = tmp_path / "copy"
    folder.mkdir()
    for path in ROOT.iterdir():
        if path.name in ("fpg_bench", "tests"):
            shutil.copytree(path, folder / path.name, ignore=shutil.ignore_patterns("__pycache__"))
        elif not path.name.startswith("."):
            (folder / path.name).symlink_to(path)
    return folder


def run(folder, *words):
    """Run Python in a folder and return what it prints; it must succeed."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    ran = subprocess.run([sys.executable, *words], cwd=folder, env=own, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout[-5000:] + ran.stderr[-5000:]
    return ran.stdout


def verbs_in(folder):
    code = "from fpg_bench.cli import _VERBS as verbs; print(*(name for name in verbs if verbs[name]))"
    return set(run(folder, "-c", code).split())


def needing(name):
    """A product and all that need it."""
    others = [other for other, product in PRODUCTS.items() if name in product.needs]
    return {name}.union(*map(needing, others))


@pytest.mark.process
@pytest.mark.slow
def test_without_a_product_the_command_line_lacks_its_verbs_alone(copy):
    known = verbs_in(copy)
    assert known == {verb.split()[1] for verb in VERBS}
    for name, product in PRODUCTS.items():
        home = copy / "fpg_bench" / product.paths[0]
        home.rename(copy / "away")
        lacking = [verb for each in needing(name) for verb in PRODUCTS[each].offers.get("verb", ())]
        assert verbs_in(copy) == known - set(lacking)
        (copy / "away").rename(home)


@pytest.mark.process
@pytest.mark.slow
def test_without_any_product_the_core_passes_its_tests_and_trains(copy):
    for product in PRODUCTS.values():
        for path in product.paths:
            target = copy / "fpg_bench" / path
            shutil.rmtree(target) if target.is_dir() else target.unlink()
    core = sorted(module for module in FILES if owner(module) is None and not module.endswith("__main__"))
    run(copy, "-c", f"import importlib; [importlib.import_module(name) for name in {core}]")
    files = [
        path.relative_to(ROOT)
        for module, path in TESTS.items()
        if module.split(".")[1] in CORE and path.name.startswith("test_") and not needs_product(module)
    ]
    assert len(files) > 40
    omitted = [word for test in OF_OTHERS for word in ("--deselect", test)]
    run(copy, "-m", "pytest", "-m", FAST, "--basetemp", copy / "temporary", *omitted, *sorted(files))
    train = ("train", "ppo", "FPG/AllyVsScripted-v0", "--steps", "300", "--n-evals", "1", "--out", "run")
    run(copy, "-m", "fpg_bench", *train)
    run(copy, "-m", "fpg_bench", "evaluate", "run/agent", "--matches", "1", "--out", "results-of-run")
