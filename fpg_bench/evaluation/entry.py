"""Entries: who is measured, a script, agents of several training seeds, or a planner."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.planning import PLANNERS, as_planner
from fpg_bench.players.naming import as_player, player_name, policy_hash
from fpg_bench.players.scripted import SCRIPTED

ALL_SCRIPTED = "all-scripted"
# What agents of one entry have in common; they differ by their training seed alone.
_MADE_BY = ("algorithm", "id", "scenario", "training_steps", "hyperparameters", "options", "policies")


@dataclass(frozen=True)
class Entry:
    """One training seed of who is measured.

    Attributes:
        name: what lines and tables call the entry; agents of several training seeds share it.
        training_seed: None for a script or a planner.
        fingerprint: what tells two players of one name apart: the hash of a policy or source file, or a word.
        make: gives the player (or planner) that meets a counterpart.
        tier: what a planner knows; None for players.
    """

    name: str
    training_seed: int | None
    fingerprint: str
    make: Callable[[Counterpart], Any]
    tier: str | None = None


def player_entry(spec: Any, name: str | None = None, training_seed: int | None = None) -> Entry:
    """A single player as an entry, by its name or itself, as it is."""
    fingerprint = policy_hash(spec) or code_fingerprint(player_name(spec))
    return Entry(name or player_name(spec), training_seed, fingerprint, Same(spec))


def entries_of(specs: Sequence[str], field: Field, name: str | None = None) -> list[Entry]:
    """The entries that players' names stand for, one per training seed.

    Agents are training seeds of one entry where all that made them is the same but the seed: algorithm,
    hyper-parameters, budget, id, scenario and whom they trained against. Entries of one algorithm that
    differ in these are called by their folders.

    Args:
        specs: players of the field's side, or ``all-scripted``.
        field: what they will meet.
        name: what to call the agents among them; None: their algorithm.

    Raises:
        UserError: no such player, one of the other side, an oracle, two agents of one entry with the same
            training seed, or a name for several entries.
    """
    every = [s for spec in specs for s in (SCRIPTED[field.side] if spec == ALL_SCRIPTED else [spec])]
    players = {spec: _player(spec, field) for spec in dict.fromkeys(every)}
    groups: dict[str, list[str]] = {}
    for spec, player in players.items():
        groups.setdefault(_made_by(spec, player), []).append(spec)
    agents = [members for members in groups.values() if _about(players[members[0]]) is not None]
    if name is not None and len(agents) > 1:
        called = " and ".join(_label(members[0]) for members in agents)
        raise UserError(f"name {name!r}: {called} were made differently, so they are several entries")
    if name in SCRIPTED[field.side]:
        raise UserError(f"name {name!r}: is a script's; call the agents otherwise")
    names = _names(groups, players, name)
    found = [_entry(spec, players[spec], names[spec], field) for spec in players]
    check_seeds(found)
    return found


def check_seeds(entries: Sequence[Entry]) -> None:
    """Raise UserError where two players of one entry say that they are the same training seed."""
    known: dict[tuple[str, int | None], str] = {}
    for entry in entries:
        who = (entry.name, entry.training_seed)
        if known.setdefault(who, entry.fingerprint) != entry.fingerprint:
            seed = "" if entry.training_seed is None else f" of training seed {entry.training_seed}"
            raise UserError(f"{entry.name}: two different players{seed}; name them one at a time")


def planner_entry(spec: Any, field: Field) -> Entry:
    """An entry from a planner, or from its name by the one grammar of planners.

    Raises:
        UserError: no such planner, one that does not say what it knows, or one by the name of another.
    """
    planner = as_planner(spec, field.scenario)
    name = spec if isinstance(spec, str) else str(getattr(spec, "name", type(spec).__name__))
    code = spec if isinstance(spec, str) else f"{type(spec).__module__}:{name}"
    if not isinstance(spec, str) and name in PLANNERS:
        raise UserError(f"planner {spec!r}: calls itself {name}, as one of the package does; rename it")
    return Entry(name, None, code_fingerprint(code), Same(spec), planner.tier)


def code_fingerprint(name: str) -> str:
    """The hash of the file that ``package.module:object`` came from; the name itself where there is none."""
    module = sys.modules.get(name.partition(":")[0])
    file = getattr(module, "__file__", None) if ":" in name else None
    return name if file is None else hashlib.sha256(Path(file).read_bytes()).hexdigest()


def _player(spec: str, field: Field) -> Any:
    player = as_player(spec, field.side, field.scenario)
    if getattr(player, "sees", "") == "state":
        raise UserError(f"{field.side} {spec!r}: sees the full state, which no field allows")
    return player


def _about(player: Any) -> dict[str, Any] | None:
    about = getattr(player, "about", None)
    return about if isinstance(about, dict) else None


def _made_by(spec: str, player: Any) -> str:
    """What agents of one entry share; a player that is no agent is an entry of its own."""
    about = _about(player)
    return spec if about is None else json.dumps([about.get(key) for key in _MADE_BY], sort_keys=True)


def _names(groups: dict[str, list[str]], players: dict[str, Any], name: str | None) -> dict[str, str]:
    found: dict[str, str] = {}
    for members in groups.values():
        about = _about(players[members[0]])
        called = player_name(members[0]) if about is None else name or str(about["algorithm"])
        found |= dict.fromkeys(members, called)
    for members in groups.values():
        shared = [spec for spec, called in found.items() if called == found[members[0]]]
        if len(shared) > len(members):
            found |= {spec: _label(spec) for spec in shared}
    return found


def _label(spec: str) -> str:
    """What an agent's folder says of its entry: the path without the training seed's part."""
    return re.sub(r"(/agent)?/?$", "", re.sub(r"/seed_\d+(?=/|$)", "", os.fspath(spec))) or spec


def _entry(spec: str, player: Any, name: str, field: Field) -> Entry:
    about = _about(player)
    fingerprint = policy_hash(player) or code_fingerprint(spec)
    # An agent travels to other machines itself, so that its files need not be there; all else by its name.
    plays = player if about is not None else spec
    return Entry(name, None if about is None else about["training_seed"], fingerprint, Same(plays))


@dataclass(frozen=True)
class Same:
    """Gives one player against everybody; unlike a closure it can be sent to a worker."""

    plays: Any

    def __call__(self, counterpart: Counterpart) -> Any:
        return self.plays
