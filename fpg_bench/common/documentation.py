"""Pages of the documentation as messages name them: published, installed, or in the source."""

from __future__ import annotations

from importlib import resources
from importlib.metadata import metadata
from pathlib import Path


def page(name: str) -> str:
    """Return where a page is: its address, else its file on this machine, else its file in the source.

    Args:
        name: folder and name without suffix, such as ``guides/datasets``.
    """
    if address := published().get("Documentation"):
        return f"{address.rstrip('/')}/{name}.html"
    file = docs_folder() / f"{name}.md"
    return str(file) if file.is_file() else f"docs/{name}.md of the source of fpg-bench"


def published() -> dict[str, str]:
    """Return the addresses of ``[project.urls]`` by label, as the package's metadata holds them."""
    lines = metadata("fpg-bench").get_all("Project-URL") or []
    return dict(line.split(", ", 1) for line in lines)


def docs_folder() -> Path:
    """Return the folder of the documentation: some pages in an installed package, all in the repository."""
    package = Path(str(resources.files("fpg_bench")))
    installed = package / "docs"
    return installed if installed.is_dir() else package.parent / "docs"
