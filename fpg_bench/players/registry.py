"""Registry of players: a name is a script, an oracle, an agent, a folder, or an object to import."""

from __future__ import annotations

import os
import re
from pathlib import Path

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import NAMED, SCRIPTED, TACTICS, other_side
from fpg_bench.common.imports import import_object
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.choosing import as_model_player
from fpg_bench.players.hub import is_on_hub
from fpg_bench.players.learners import Learner
from fpg_bench.players.player import Player, PlayerSpec
from fpg_bench.players.scripted import ORACLES, OracleAlly, OracleOpponent, Scripted
from fpg_bench.players.tactics import Tactic

_VARIANT = re.compile(r"([a-z-]+)\((.*)\)")


def as_player(spec: PlayerSpec, side: str, scenario: Scenario) -> Player:
    """Return the player that ``spec`` names.

    Args:
        spec: a script (``expert``), a script with memory and other constants than its own
            (``alternate(centres=3)``), a learner (``ucb``), ``oracle``, a shipped agent
            (``ally-scripted/ppo/seed_0``), an agent folder, an agent on the Hugging Face Hub
            (``hf://owner/name``), a member of a suite (``suite:NAME/MEMBER``),
            ``package.module:object`` (a player, or a class or function that makes one, called with the
            scenario if it takes an argument), or any object with ``predict``. Whole numbers that a model
            of discrete actions predicts are taken as choices.
        side: ``ally`` or ``opponent``.
        scenario: what is played.

    Raises:
        UserError: no such player, one that cannot be made, not one of this side, or a model of other choices.
    """
    if not isinstance(spec, str | os.PathLike):
        if callable(getattr(spec, "predict", None)):
            return as_model_player(spec, side, scenario)
        raise UserError(f"{side}: expected a player's name or an object with predict, got {spec!r}")
    name = os.fspath(spec)
    if variant := _VARIANT.fullmatch(name):
        return _script_with(variant[1], variant[2], side, scenario)
    if name in TACTICS[side]:
        return Tactic(side, name, scenario)
    if name in SCRIPTED[side]:
        return Scripted(side, name, scenario)
    if name in NAMED[side]:
        return Learner(name, scenario)
    if name in ORACLES:
        return OracleAlly(scenario) if side == "ally" else OracleOpponent(scenario)
    if name.startswith("suite:"):
        from fpg_bench.players.population import load_member

        return load_member(name, side)
    if ":" in name and not is_on_hub(name):
        player: Player = import_object(name, side, ("predict",), scenario)
        return player
    if "/" in name or (name and Path(name).is_dir()):
        from fpg_bench.players.agent import load_agent

        return load_agent(name, side)
    if name in NAMED[other_side(side)]:
        raise _of_other_side(name, side)
    raise UserError(f"unknown {side} {name!r}{nearest(name, [*NAMED[side], *ORACLES])}")


def _script_with(name: str, values: str, side: str, scenario: Scenario) -> Tactic:
    """Return a script with the constants of a text such as ``centres=3, hold_s=2``."""
    if name in NAMED[other_side(side)]:
        raise _of_other_side(name, side)
    if name not in TACTICS[side]:
        known = ", ".join(TACTICS[side])
        raise UserError(
            f"{side} {name!r} has no constants{nearest(name, TACTICS[side])}; these have: {known}"
        )
    changes = {}
    for text in filter(None, map(str.strip, values.split(","))):
        key, _, number = text.partition("=")
        try:
            changes[key.strip()] = float(number)
        except ValueError:
            raise UserError(f"{name}: expected NAME=NUMBER, got {text!r}") from None
    return Tactic(side, name, scenario, **changes)


def _of_other_side(name: str, side: str) -> UserError:
    return UserError(f"{name!r} plays the {other_side(side)}; name a player of the {side}")


def policy_hash(player: object) -> str | None:
    """Return the SHA-256 of an agent's policy; None for any other player."""
    about = getattr(player, "about", None)
    sha256 = about.get("policy_sha256") if isinstance(about, dict) else None
    return None if sha256 is None else str(sha256)


def player_name(spec: PlayerSpec) -> str:
    """Return the name of a player in rows and tables: its specification, or its class."""
    return os.fspath(spec) if isinstance(spec, str | os.PathLike) else type(spec).__name__
