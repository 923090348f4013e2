"""The line between the core and its products: the core finds products, and asks them for objects by name.

A product is a folder of ``fpg_bench/products`` with a ``product.toml``, which says what the product is, which
others it needs, and what it offers. A package of another distribution is a product, too, if it has such a
file and an entry point of the group ``fpg_bench.products``. The core imports no product: it calls
:func:`load`
with a kind and a name, and only then is the product imported. A product is deleted with its folder.

.. code-block:: toml

    summary = "Uploads agents to the Hugging Face Hub, and downloads them."
    needs = ["leaderboard"]

    [verb]
    hub = "fpg_bench.products.hub.verbs:app"

Kinds of offers:

- ``verb``: a verb of the command line: a function or a :class:`typer.Typer`.
- ``game``: a game of another kind than the duel, by its id: :class:`fpg_bench.game.spec.GameProduct`.
- ``planner``: a class of planners of the opponent's path, made for a scenario if it takes an argument.
- ``planner tier``: what a planner knows, as its class says; lists of names do not import it.
- ``algorithm``, ``joint algorithm``, ``offline algorithm``: a class of SB3's ``BaseAlgorithm`` that trains
  one side or both, or learns from a data set.
- ``player``: the function that fetches an agent by a scheme (``hf://``), or makes one of a file by its suffix
  (``.zip``), and the player of agents of others (``untrusted``).
- ``rendering``: what draws rounds, or shows link budgets, by suffix or by name.
- ``language model``: the functions that record, replay and pay for language models, and the options that
  they add to verbs.
"""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import logging
import pkgutil
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError

KINDS = (
    "verb",
    "game",
    "planner",
    "planner tier",
    "algorithm",
    "joint algorithm",
    "offline algorithm",
    "player",
    "rendering",
    "language model",
)
MANIFEST = "product.toml"
_PRODUCTS = Path(__file__).parents[1] / "products"
_GROUP = "fpg_bench.products"
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Product:
    """A part that the core does not need.

    Attributes:
        folder: its folder.
        summary: what it is, in a sentence.
        needs: names of the products that it imports.
        offers: what it offers the core, by kind and name, as ``module:object``.
    """

    folder: Path
    summary: str
    needs: tuple[str, ...]
    offers: Mapping[str, Mapping[str, str]]


@functools.cache
def products() -> Mapping[str, Product]:
    """Return the products that are installed together with all that they need, by name.

    A product whose manifest cannot be read, or that offers something of an unknown kind, is left out with a
    warning: it may be of another distribution, without which everything else works.
    """
    read = map(_read, _folders())
    found = {product.folder.name: product for product in read if product is not None}
    while lacking := [name for name, product in found.items() if not found.keys() >= {*product.needs}]:
        for name in lacking:
            del found[name]
    return found


def _folders() -> Iterator[Path]:
    """Yield the folders in which manifests may lie; no package is imported."""
    yield from sorted(_PRODUCTS.iterdir()) if _PRODUCTS.is_dir() else ()
    for point in importlib.metadata.entry_points(group=_GROUP):
        spec = importlib.util.find_spec(point.value)
        yield from map(Path, spec.submodule_search_locations or ()) if spec else ()


def _read(folder: Path) -> Product | None:
    """Return the product of a folder; None without a manifest, and with a warning for a wrong one."""
    try:
        content = tomllib.loads((folder / MANIFEST).read_text("utf-8"))
        summary, needs = content.pop("summary", ""), content.pop("needs", ())
        if unknown := next((kind for kind in content if kind not in KINDS), None):
            raise ValueError(f"offers {unknown!r}; expected {', '.join(KINDS)}")
        return Product(folder, summary, tuple(needs), content)
    except OSError:
        return None
    except ValueError as error:
        _logger.warning(f"product {folder / MANIFEST}: {error}; it is left out")
        return None


@functools.cache
def offered(kind: str) -> Mapping[str, str]:
    """Return what products offer of a kind, by name, as ``module:object``."""
    return {k: place for product in products().values() for k, place in product.offers.get(kind, {}).items()}


def load(kind: str, name: str) -> Any:
    """Return what a product offers, and import it.

    Raises:
        UserError: no product offers it.
    """
    if name not in offered(kind):
        raise UserError(f"{kind} {name!r}: no product of this copy of fpg-bench offers it")
    return pkgutil.resolve_name(offered(kind)[name])


def files_of_products(pattern: str) -> Iterator[Path]:
    """Yield the files of all products that match a pattern below their folders."""
    for product in products().values():
        yield from product.folder.glob(pattern)
