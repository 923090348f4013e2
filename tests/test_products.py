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

from fpg_bench.common.errors import UserError
from fpg_bench.common.products import KINDS, load, offered, products
from tests.programs import ROOT
from tests.test_cli import VERBS
from tests.test_layout import FILES, graph

PRODUCTS = ROOT / "fpg_bench/products"
CORE = ("game", "envs", "players", "evaluation")  # folders of tests that are run without products
# A planner of a product is the default of an id, and rivals of a suite fly as planners say.
WITH_PLANNERS = (
    "AllyVsPlanner or ally-planner or every_id_has_its_suite or committed_suites_stay or rounded_up_to_whole "
    "or action_of_any_seat or change3"
)
FAST = "not (full or process or slow)"
TESTS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in (ROOT / "tests").rglob("*.py")
}
SCRIPTS = {path.stem: path for path in (ROOT / "scripts").glob("*.py")}  # which tests import, too


def owner(module):
    """The product that a module of the package, or a test of it, belongs to; None: the core."""
    return next(iter(re.findall(r"(?:^|\.)products\.(\w+)", module)), None)


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
        if owner(module) is None
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and re.fullmatch(r"fpg_bench\.[\w.:]+", str(node.value))
    ]
    assert [pair for pair in named if owner(pair[1].partition(":")[0])] == []


def test_products_say_what_they_are_and_which_products_they_need():
    needed = {name: {owner(to) for of, to in crossings() if owner(of) == name} for name in products()}
    assert {name: set(product.manifest.needs) for name, product in products().items()} == needed
    assert all(product.manifest.summary.endswith(".") for product in products().values())
    assert {path.name for path in PRODUCTS.iterdir() if path.is_dir() and path.name != "__pycache__"} == {
        *products()
    }


def test_the_map_shows_the_products_and_names_what_there_is():
    page = (ROOT / "docs/project/map.md").read_text(encoding="utf-8")
    for name, product in products().items():
        summary, needs = product.manifest.summary, ", ".join(product.manifest.needs)
        assert f"| `{name}` | {summary} | {needs or '-'} |" in page
    places = re.findall(r"`((?:fpg_bench|baselines|tests)/[\w./]+)`", page)
    assert not [place for place in places if not (ROOT / place).exists()]
    rows = [line for line in page.splitlines() if line.startswith("|")]
    for row in rows:  # a name stands in the file before it
        for place, names in re.findall(r"`([\w./]+\.py)`: ((?:`\w+`(?:, )?)+)", row):
            text = (ROOT / place).read_text(encoding="utf-8")
            assert not [name for name in re.findall(r"\w+", names) if name not in text], place


@pytest.mark.parametrize("kind", KINDS)
def test_what_products_offer_is_theirs_and_is_there(kind):
    assert offered(kind)
    for name, product in products().items():
        for offer in product.offers(kind).values():
            assert owner(offer.place.partition(":")[0]) == name
            assert pkgutil.resolve_name(offer.place) is not None


@pytest.mark.parametrize("name", offered("planner"))
def test_the_tier_of_a_planner_is_that_of_its_class(name):
    made = load("planner", name)
    assert getattr(made, "func", made).tier == offered("planner")[name].tier


def forget():
    products.cache_clear()
    offered.cache_clear()


@pytest.fixture
def none_installed(monkeypatch, tmp_path):
    """Without products of the package."""
    monkeypatch.setattr("fpg_bench.common.products._PRODUCTS", tmp_path / "products")
    forget()
    yield tmp_path
    forget()


def test_without_products_nothing_is_offered_and_the_message_says_so(none_installed):
    with_core = [kind for kind in KINDS if offered(kind)]
    assert with_core == ["verb", "ally", "opponent", "planner", "algorithm", "agent"]
    with pytest.raises(UserError, match=r"planner 'llm': no product of this copy of fpg-bench offers it"):
        load("planner", "llm")


def install(folder, name, manifest, entry=None):
    """Install a package of another distribution, ``their-NAME``, which fails where it is imported."""
    package = folder / name
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError('imported before it is used')")
    if manifest is not None:
        (package / "product.toml").write_text(manifest)
    distribution = folder / f"their_{name}-1.0.dist-info"
    distribution.mkdir()
    (distribution / "METADATA").write_text(f"Metadata-Version: 2.1\nName: their-{name}\nVersion: 1.0\n")
    (distribution / "entry_points.txt").write_text(f"[fpg_bench.products]\n{name} = {entry or name}\n")


FAULTS = {  # a package, its manifest and entry point, and what the warning says
    "syntax": ("mine", "summary = ", None, "Invalid value"),
    "kind": ("mine", '[actor]\na = "b:c"', None, "unknown key 'actor'"),
    "needs": ("mine", "needs = 3", None, "needs: expected a list, got 3"),
    "verbs": ("mine", 'verb = "x"', None, "verb: expected a mapping, got 'x'"),
    "place": ("mine", "[verb]\nx = 'os.getcwd'", None, "expected package.module:object, got 'os.getcwd'"),
    "tier": ("mine", "[planner]\nx = 'a:b'", None, "planner.x: lacks tier"),
    "name": ("mine", "[ally]\n'a/b' = 'a:b'", None, "expected a word such as my-name, got 'a/b'"),
    "parent": ("mine", "", "nowhere.mine", "No module named 'nowhere'"),
    "module": ("mine", "", "mine:Product", "no package 'mine:Product'"),
    "none": ("mine", None, None, "No such file"),
    "raises": ("mine", "", "mine.inner", "imported before it is used"),
    "verb": ("mine", "[verb]\ntrain = 'a:b'", None, "offers the verb 'train', as the core does"),
    "player": ("mine", "[ally]\nucb = 'a:b'", None, "offers the ally 'ucb', as theory does"),
    "oracle": ("mine", "[opponent]\noracle = 'a:b'", None, "offers the opponent 'oracle', as the core does"),
    "package": ("teams", "", None, "another product is called 'teams'; rename the package"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_a_package_of_others_costs_one_warning_that_names_its_distribution(
    fault, monkeypatch, tmp_path, caplog
):
    package, manifest, entry, message = FAULTS[fault]
    install(tmp_path, package, manifest, entry)
    with monkeypatch.context() as patch:
        before = {kind: {**offered(kind)} for kind in KINDS}
        patch.syspath_prepend(tmp_path)
        forget()
        assert {kind: {**offered(kind)} for kind in KINDS} == before
    forget()
    (line,) = caplog.messages
    assert f"distribution their-{package}: " in line
    assert message in line
    assert line.endswith("; it is left out")


@pytest.mark.process
def test_a_verb_of_others_that_fails_ends_no_other_verb(tmp_path):
    install(tmp_path, "mine", '[verb]\nbroken = "mine:verb"\n')
    own = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    for words, status, text in (
        (["--help"], 0, "broken"),
        (["broken"], 2, "fpg-bench: verb 'broken' of distribution their-mine: RuntimeError: imported before"),
    ):
        ran = subprocess.run(
            [sys.executable, "-m", "fpg_bench", *words], env=own, capture_output=True, text=True
        )
        assert (ran.returncode, text in ran.stdout + ran.stderr) == (status, True), ran.stderr


def test_a_product_whose_needs_are_not_installed_offers_nothing(none_installed):
    for name, needs in (("first", ["second"]), ("second", ["third"]), ("alone", [])):
        (none_installed / "products" / name).mkdir(parents=True)
        text = f'summary = "One."\nneeds = {needs}\n[verb]\n{name} = "{name}:verb"\n'
        (none_installed / "products" / name / "product.toml").write_text(text)
    assert list(products()) == ["alone"]
    assert "alone" in offered("verb")
    assert not {"first", "second"} & offered("verb").keys()


def test_a_shipped_product_with_a_wrong_manifest_is_left_out_with_a_line(none_installed, caplog):
    for name, content in (("mine", "summary = "), ("other", 'summary = "Another."')):
        (none_installed / "products" / name).mkdir(parents=True)
        (none_installed / "products" / name / "product.toml").write_text(content)
    assert list(products()) == ["other"]
    (line,) = caplog.messages
    assert re.search(r"mine: Invalid value.*; it is left out$", line)


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
    code = "from fpg_bench.common.products import offered; print(*offered('verb'))"
    return set(run(folder, "-c", code).split())


def needing(name):
    """A product and all that need it."""
    others = [other for other, product in products().items() if name in product.manifest.needs]
    return {name}.union(*map(needing, others))


@pytest.mark.full
@pytest.mark.process
@pytest.mark.slow
def test_without_a_product_the_command_line_lacks_its_verbs_alone(copy):
    known = verbs_in(copy)
    assert known == {verb.split()[1] for verb in VERBS}
    for name in products():
        (copy / "fpg_bench/products" / name).rename(copy / "away")
        lacking = [verb for each in needing(name) for verb in products()[each].offers("verb")]
        assert verbs_in(copy) == known - set(lacking)
        (copy / "away").rename(copy / "fpg_bench/products" / name)


@pytest.mark.full
@pytest.mark.process
@pytest.mark.slow
def test_without_any_product_the_core_passes_its_tests_and_trains(copy):
    for folder in ("fpg_bench/products", "tests/products"):
        shutil.rmtree(copy / folder)
    core = sorted(module for module in FILES if owner(module) is None and not module.endswith("__main__"))
    core.remove("fpg_bench.products")
    run(copy, "-c", f"import importlib; [importlib.import_module(name) for name in {core}]")
    files = [f"tests/{folder}" for folder in CORE]
    run(
        copy,
        "-m",
        "pytest",
        "-m",
        FAST,
        "-k",
        f"not ({WITH_PLANNERS})",
        "--basetemp",
        copy / "temporary",
        *files,
    )
    train = ("train", "ppo", "FPG/AllyVsScripted-v0", "--steps", "300", "--n-evals", "1", "--out", "run")
    run(copy, "-m", "fpg_bench", *train)
    run(copy, "-m", "fpg_bench", "evaluate", "run/agent", "--matches", "1", "--out", "results-of-run")
