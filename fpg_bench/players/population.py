"""A field's agents as a population to draw from: ``field:NAME`` all of them, ``field:NAME/MEMBER`` one."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.players.agent import OnnxPlayer, baselines_folder, load_agent
from fpg_bench.players.player import SIDES

PREFIX = "field:"


class FieldMember(OnnxPlayer):
    """An agent that flies as it was trained to: one that never learned to fly pursues the ally.

    Under the path ``learned`` such an opponent's rounds are those of the path ``pursuit``, to the bit. So
    opponents of both kinds can be drawn in one game.
    """

    @property
    def flies(self) -> str:
        """``learned`` where the opponent flew itself while it was trained, else ``pursuit``."""
        return flight_of(self.about)


def flight_of(about: dict[str, Any]) -> str:
    """How the opponent flew while an agent was trained, by its ``agent.json``: ``learned`` or ``pursuit``."""
    fields = about.get("scenario_fields")
    path = fields.get("opponent_path", "pursuit") if isinstance(fields, dict) else "pursuit"
    return "learned" if path == "learned" or (isinstance(path, list) and "learned" in path) else "pursuit"


def as_member(folder: str | os.PathLike[str], side: str | None = None) -> FieldMember:
    """A field's member from its agent folder; raises as :func:`fpg_bench.players.agent.load_agent` does."""
    agent = load_agent(folder, side)
    return FieldMember(agent.model, agent.about)


def with_members(specs: Iterable[Any], side: str) -> list[Any]:
    """A list of players in which each field's name has given way to its members of a side.

    Args:
        specs: players as :func:`fpg_bench.players.naming.as_player` takes them, and fields: ``field:NAME``, a
            folder of ``baselines/fields`` or any other with ``ally/<member>/`` or ``opponent/<member>/``.
        side: ``ally`` or ``opponent``.

    Raises:
        UserError: no such field, or one without members of this side.
    """
    return [member for spec in specs for member in (_members(spec, side) if _is_field(spec) else [spec])]


def load_member(spec: str, side: str) -> FieldMember:
    """The player that ``field:NAME/MEMBER`` names.

    Raises:
        UserError: no such field or member, a whole field, or a member that is damaged or plays another side.
    """
    name = spec.removeprefix(PREFIX)
    if _folder(name) is not None:
        raise UserError(f"{spec}: is a whole field, to draw from per round; here one player is expected")
    field, _, member = name.rpartition("/")
    known = _members(PREFIX + field, side) if field else []
    if spec not in known:
        raise UserError(
            f"{side} {spec!r}: no such field{nearest(name, _shipped())}"
            if not known
            else f"{side} {spec!r}: the field has no such member{nearest(spec, known)}"
        )
    folder = _folder(field)
    assert folder is not None
    return as_member(folder / side / member, side)


def _is_field(spec: Any) -> bool:
    return (
        isinstance(spec, str) and spec.startswith(PREFIX) and _folder(spec.removeprefix(PREFIX)) is not None
    )


def _members(spec: str, side: str) -> list[str]:
    """The names of a field's members of a side, in the order of the alphabet."""
    name = spec.removeprefix(PREFIX)
    folder = _folder(name)
    if folder is None:
        raise UserError(f"{side} {spec!r}: no such field{nearest(name, _shipped())}")
    inside = folder / side
    found = sorted(entry.name for entry in inside.iterdir() if entry.is_dir()) if inside.is_dir() else []
    if not found:
        raise UserError(f"{spec}: has no members that play the {side}")
    return [f"{PREFIX}{name.rstrip('/')}/{member}" for member in found]


def _folder(name: str) -> Path | None:
    """Where a field of this name lies, if there is one."""
    places = [baselines_folder() / "fields" / name, Path(name)] if name else []
    return next((place for place in places if any((place / side).is_dir() for side in SIDES)), None)


def _shipped() -> list[str]:
    """The names of the fields that come with the package."""
    fields = baselines_folder() / "fields"
    return [entry.name for entry in fields.iterdir() if entry.is_dir()] if fields.is_dir() else []
