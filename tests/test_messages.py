"""Messages name pages of the documentation that their reader has."""

from __future__ import annotations

import ast
import re
from email.message import Message
from pathlib import Path

import fpg_bench
from fpg_bench.common import output
from fpg_bench.common.output import docs_folder, page
from tests.environments import ROOT

PACKAGE = Path(fpg_bench.__file__).parent
PAGE = re.compile(r"docs/\S+\.md")
# They write pages: reports beside the documentation, and the site, which has no address of it to name.
NOT_MESSAGES = {"products/papers/yang_2026/report.py", "products/leaderboard/site/build.py"}


def texts(file: Path):
    """All texts of a module, those of f-strings and docstrings included."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def named_pages(file: Path):
    """The pages that a module names by :func:`page`."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "page":
            yield from (argument.value for argument in node.args if isinstance(argument, ast.Constant))


def test_no_message_names_a_page_by_a_file_that_an_installed_package_lacks():
    modules = {file.relative_to(PACKAGE).as_posix(): file for file in PACKAGE.rglob("*.py")}
    found = [(name, text) for name, file in modules.items() for text in texts(file) if PAGE.search(text)]
    assert [pair for pair in found if pair[0] not in NOT_MESSAGES] == []


def test_pages_that_messages_name_exist():
    names = {name for file in PACKAGE.rglob("*.py") for name in named_pages(file)}
    assert {"guides/datasets", "benchmark/submitting", "reference/rules"} <= names
    assert [name for name in names if not (ROOT / "docs" / f"{name}.md").is_file()] == []


def test_a_page_is_its_address_its_file_or_its_place_in_the_source(monkeypatch, tmp_path):
    assert page("reference/rules") == str(docs_folder() / "reference/rules.md")
    monkeypatch.setattr(output, "docs_folder", lambda: tmp_path)
    assert page("guides/datasets") == "docs/guides/datasets.md of the source of fpg-bench"
    about = Message()
    about["Project-URL"] = "Documentation, https://example.org/docs/"
    monkeypatch.setattr(output, "metadata", lambda name: about)
    assert page("guides/datasets") == "https://example.org/docs/guides/datasets.html"
