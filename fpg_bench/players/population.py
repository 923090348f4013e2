"""Agents of a suite as players: ``suite:NAME`` for all of them, ``suite:NAME/MEMBER`` for one."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.imports import SUITE
from fpg_bench.players.agent import OnnxPlayer, load_agent, suites_folder
from fpg_bench.players.player import SIDES, PlayerSpec


class SuiteMember(OnnxPlayer):
    """An agent that flies as in its training: an opponent that never learned to fly pursues the ally.

    Under the path ``learned`` such an opponent's rounds are bit-identical to those of the path
    ``pursuit``, so one game can draw opponents of both kinds.
    """

    @property
    def flies(self) -> str:
        """``learned`` if the opponent flew itself in its training, otherwise ``pursuit``."""
        assert self.card is not None
        return self.card.flies


def member_from_folder(folder: str | os.PathLike[str], side: str | None = None) -> SuiteMember:
    """Load a member from its agent folder; raises as :func:`fpg_bench.players.agent.load_agent`."""
    agent = load_agent(folder, side)
    return SuiteMember(agent.model, agent.card)


def expand_suites(specs: Iterable[PlayerSpec], side: str) -> list[PlayerSpec]:
    """Replace each suite in a list of players by its members of a side.

    Any other player is returned as it is, also one that does not exist; loading it raises.

    Args:
        specs: players as :func:`fpg_bench.players.registry.as_player` takes them, and suites: ``suite:NAME``,
            a folder of ``baselines/suites`` or any other with ``ally/<member>/`` or ``opponent/<member>/``.
        side: ``ally`` or ``opponent``.

    Raises:
        UserError: a suite has no members of this side.
    """
    players: list[PlayerSpec] = []
    for spec in specs:
        if isinstance(spec, str) and spec.startswith(SUITE) and _folder(spec.removeprefix(SUITE)):
            players += _members(spec, side)
        else:
            players.append(spec)
    return players


def member_folder(spec: str, side: str) -> str:
    """Return the name of a member's folder, ``NAME/SIDE/MEMBER``, and any other player's name as it is.

    Raises:
        UserError: no such suite or member, or a whole suite.
    """
    if not spec.startswith(SUITE):
        return spec
    name = spec.removeprefix(SUITE)
    if _folder(name) is not None:
        raise UserError(f"{spec}: names a whole suite; expected a single player")
    suite, _, member = name.rpartition("/")
    known = _members(SUITE + (suite or name), side)
    if spec not in known:
        raise UserError(f"{side} {spec!r}: the suite has no such member{nearest(spec, known)}")
    return f"{suite}/{side}/{member}"


def load_member(spec: str, side: str) -> SuiteMember:
    """Load the player that ``suite:NAME/MEMBER`` names.

    Raises:
        UserError: no such suite or member, a whole suite, or an agent that cannot be loaded as this side.
    """
    return member_from_folder(member_folder(spec, side), side)


def _members(spec: str, side: str) -> list[str]:
    """Return the names of a suite's members of a side, in alphabetical order."""
    name = spec.removeprefix(SUITE)
    folder = _folder(name)
    if folder is None:
        shipped = [path.name for path in suites_folder().iterdir() if path.is_dir()]
        raise UserError(f"{side} {spec!r}: no such suite{nearest(name, shipped)}")
    members = sorted(path.name for path in (folder / side).glob("*/"))
    if not members:
        raise UserError(f"{spec}: has no members that play the {side}")
    return [f"{SUITE}{name.rstrip('/')}/{member}" for member in members]


def _folder(name: str) -> Path | None:
    """Return the folder of a suite; None if there is no such suite."""
    places = [suites_folder() / name, Path(name)] if name else []
    return next((place for place in places if any((place / side).is_dir() for side in SIDES)), None)
