"""Agents that lie elsewhere: their names, ``hf://owner/name@revision``, and who fetches them."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, TypeVar

from fpg_bench.common.products import load, offered

_SCHEMES = tuple(name for name in offered("agent") if name.endswith("://"))
Spec = TypeVar("Spec")


class Fetched(Protocol):
    """An agent that was fetched.

    Attributes:
        name: name of the player that never changes.
        folder: the folder of its files on this machine.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def folder(self) -> Path: ...  # noqa: D102


def is_remote(name: object) -> bool:
    """Return True if a player's name stands for an agent elsewhere, such as on the Hugging Face Hub."""
    return isinstance(name, str) and name.startswith(_SCHEMES)


def fetch(name: str) -> Fetched:
    """Fetch an agent by its player's name; a name stands for one content as long as the program runs.

    Raises:
        UserError: it cannot be fetched; see :func:`fpg_bench.products.hub.download.download`.
    """
    fetched: Fetched = load("agent", next(filter(name.startswith, _SCHEMES)))(name)
    return fetched


def pinned(spec: Spec) -> Spec:
    """Return a player, or a list of players, with the commit in each name of an agent elsewhere."""
    if isinstance(spec, list | tuple):
        return type(spec)(map(pinned, spec))
    return fetch(spec).name if isinstance(spec, str) and is_remote(spec) else spec  # type: ignore[return-value]
