"""The line between the core and its products: what offers what, by kind and name.

A product is a folder of ``fpg_bench/products`` with a ``product.toml``, which says what the product is, which
others it needs, and what it offers. A package of another distribution is a product, too, if it has such a
file and an entry point of the group ``fpg_bench.products``. The core has such a file of its own, and imports
no product: it calls :func:`load` with a kind and a name, and only then is the product imported. A product is
deleted with its folder.

.. code-block:: toml

    summary = "Uploads agents to the Hugging Face Hub, and downloads them."
    needs = ["leaderboard"]

    [verb]
    hub = "fpg_bench.products.hub.verbs:app"

:class:`Manifest` lists the kinds of offers. No two products offer the same name of a kind.
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
from typing import Annotated, Any, Literal, TypeVar

from pydantic import ConfigDict, Field, model_validator

from fpg_bench.common.errors import UserError, first_line
from fpg_bench.common.imports import reason
from fpg_bench.common.schema import Expected, Items, Strict, parse

MANIFEST = "product.toml"
_PACKAGE = Path(__file__).parents[1]
_PRODUCTS = _PACKAGE / "products"
_GROUP = "fpg_bench.products"
_logger = logging.getLogger(__name__)


class Offer(Strict):
    """The object that a name stands for; in a manifest also the place alone.

    Attributes:
        place: what is loaded, as ``package.module:object``.
    """

    place: Annotated[str, Field(pattern=r"^\w+(\.\w+)*:\w+$"), Expected("package.module:object")]

    @model_validator(mode="before")
    @classmethod
    def _read(cls, value: Any) -> Any:
        return {"place": value} if isinstance(value, str) else value


class PlayerOffer(Offer):
    """A player of a side: what is called with side, name and scenario, and returns it.

    Attributes:
        group: heading in lists of players; only ``scripts`` are rivals where an id asks for a script.
    """

    group: str = "scripts"


class PlannerOffer(Offer):
    """A planner of the path: a class or function, called with the scenario if it takes an argument.

    Attributes:
        tier: what it knows, as its class says; lists of names do not import it.
    """

    tier: Literal["none", "history", "ally"]


class AlgorithmOffer(Offer):
    """An algorithm: a subclass of SB3's ``BaseAlgorithm``.

    Its hyper-parameters are in ``hyperparams/NAME.yml`` and its search space in ``search/NAME.yml``, in
    the folder of its product or in ``baselines``.

    Attributes:
        base: the algorithm of which it is a variant, with hyper-parameters of its own; None: it is none.
        search: the algorithm whose search space it has; None: its own.
        stacks: whether it may see stacked frames, as ``ppo-stack8``.
        trains: ``one`` side, ``both`` sides, or from ``data``.
    """

    base: str | None = None
    search: str | None = None
    stacks: bool = True
    trains: Literal["one", "both", "data"] = "one"


T = TypeVar("T", bound=Offer)
_Names = dict[Annotated[str, Field(pattern="^[a-z0-9][a-z0-9-]*$"), Expected("a word such as my-name")], T]
_Any = dict[str, Offer]
_NONE: Any = Field(default_factory=dict)


class Manifest(Strict):
    """A product's ``product.toml``.

    Attributes:
        summary: what the product is, in a sentence.
        needs: names of the products that it imports.
        verb: verbs of the command line: a function or a :class:`typer.Typer`.
        ally, opponent: players of a side.
        oracle: oracles of an SNR model that the core has none of, made as players are.
        planner: planners of the opponent's path.
        algorithm: algorithms.
        game: games of another kind than the duel, by their ids: :class:`fpg_bench.game.spec.GameProduct`.
        agent: what fetches an agent by a scheme (``hf://``), makes one of a file by its suffix (``.zip``),
            and plays agents of others (``untrusted``) and models of Stable-Baselines3 (``live``); and
            what ``train --against zoo`` draws from.
        rendering: what draws rounds, scores and curves, shows link budgets, and has the columns of planners'
            tables, by suffix or by name.
        language_model: what records, replays and pays for language models, the season in which they answer,
            and options that they add to verbs.
    """

    model_config = ConfigDict(populate_by_name=True)

    summary: str = ""
    needs: Items[str] = ()
    verb: _Names[Offer] = _NONE
    ally: _Names[PlayerOffer] = _NONE
    opponent: _Names[PlayerOffer] = _NONE
    oracle: _Any = _NONE
    planner: _Names[PlannerOffer] = _NONE
    algorithm: _Names[AlgorithmOffer] = _NONE
    game: _Any = _NONE
    agent: _Any = _NONE
    rendering: _Any = _NONE
    language_model: _Any = _NONE


KINDS = tuple(name for name in Manifest.model_fields if name not in ("summary", "needs"))


@dataclass(frozen=True)
class Product:
    """A part that the core does not need.

    Attributes:
        folder: its folder.
        manifest: what it says of itself.
        distribution: that of a package of others; None: it is shipped.
    """

    folder: Path
    manifest: Manifest
    distribution: str | None = None

    def offers(self, kind: str) -> Mapping[str, Any]:
        """Return what it offers of a kind, by name."""
        offers: Mapping[str, Any] = getattr(self.manifest, kind)
        return offers

    def __str__(self) -> str:
        if self.folder == _PACKAGE:
            return "the core"
        return self.folder.name if self.distribution is None else f"distribution {self.distribution}"


@functools.cache
def products() -> Mapping[str, Product]:
    """Return the products that are installed together with all that they need, by name.

    A product that cannot be read, or that has a name, or offers one, that another has, is left out with a
    warning, which names the distribution of a package of others.
    """
    found: dict[str, Product] = {}
    for folder, distribution in _folders():
        try:
            if (product := _read(folder, distribution)) is not None:
                _check_new(product, found)
                found[product.folder.name] = product
        except Exception as error:  # of the parent package of another's, too
            of = "" if distribution is None else f" of distribution {distribution}"
            _logger.warning(f"product {folder}{of}: {first_line(error)}; it is left out")
    while lacking := [
        name for name, product in found.items() if not found.keys() >= {*product.manifest.needs}
    ]:
        for name in lacking:
            del found[name]
    return found


def _folders() -> Iterator[tuple[Path | str, str | None]]:
    """Yield folders in which manifests may lie, or packages, with their distribution; None: shipped."""
    for folder in sorted(_PRODUCTS.iterdir()) if _PRODUCTS.is_dir() else ():
        yield folder, None
    for point in importlib.metadata.entry_points(group=_GROUP):
        yield point.value, point.dist.name if point.dist else point.name


def _read(folder: Path | str, distribution: str | None = None) -> Product | None:
    """Return the product of a folder or of a package, which is not imported; None for one without a manifest.

    Raises:
        ImportError: no such package.
        OSError: a package of others without a manifest.
        ValueError: a wrong manifest.
    """
    if isinstance(folder, str):
        spec = importlib.util.find_spec(folder)
        if spec is None or not spec.submodule_search_locations:
            raise ModuleNotFoundError(f"no package {folder!r}")
        folder = Path(spec.submodule_search_locations[0])
    try:
        content = tomllib.loads((folder / MANIFEST).read_text("utf-8"))
    except OSError:
        if distribution is None:
            return None
        raise
    return Product(folder, parse(Manifest, content, MANIFEST), distribution)


def _check_new(product: Product, others: Mapping[str, Product]) -> None:
    """Raise UserError if a product has the name of another, or offers what another does."""
    if product.folder.name in others:
        raise UserError(f"another product is called {product.folder.name!r}; rename the package")
    for other in (_core(), *others.values()):
        for kind in KINDS:
            for name in product.offers(kind).keys() & other.offers(kind).keys():
                raise UserError(f"offers the {kind} {name!r}, as {other} does; choose another name")


@functools.cache
def _core() -> Product:
    """Return what the core itself offers, as if it were a product."""
    core = _read(_PACKAGE)
    assert core is not None
    return core


@functools.cache
def offered(kind: str) -> Mapping[str, Any]:
    """Return what the core and the products offer of a kind, by name: of each an :class:`Offer`."""
    every = (_core(), *products().values())
    return {name: offer for product in every for name, offer in product.offers(kind).items()}


def load(kind: str, name: str) -> Any:
    """Return what is offered, and import it.

    Raises:
        UserError: nothing of this name is offered, or it cannot be imported from a distribution of others.
    """
    if name not in offered(kind):
        raise UserError(f"{kind} {name!r}: no product of this copy of fpg-bench offers it")
    try:
        return pkgutil.resolve_name(offered(kind)[name].place)
    except Exception as error:
        if (product := offering(kind, name)).distribution is None:
            raise
        raise UserError(f"{kind} {name!r} of {product}: {reason(error)}") from error


def offering(kind: str, name: str) -> Product:
    """Return the product that offers a name."""
    return next(each for each in (_core(), *products().values()) if name in each.offers(kind))


def code_of(kind: str, name: str) -> str:
    """Return ``package.module:object`` for what a distribution of others offers, since it may change.

    Any other name is returned as it is.
    """
    is_theirs = name in offered(kind) and offering(kind, name).distribution is not None
    return offered(kind)[name].place if is_theirs else name


def files_of_products(pattern: str) -> Iterator[Path]:
    """Yield the files of all products that match a pattern below their folders."""
    for product in products().values():
        yield from product.folder.glob(pattern)
