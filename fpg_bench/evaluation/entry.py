"""Entries of an evaluation: scripts, agents of several training seeds, and planners."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.common.checks import of_kind, title
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import NAMED, ORACLES, SCRIPTED
from fpg_bench.common.imports import code_fingerprint, is_code
from fpg_bench.common.products import code_of
from fpg_bench.common.schema import Word, parse
from fpg_bench.envs.two_player import PlannerSpec
from fpg_bench.evaluation.rounds import Players
from fpg_bench.evaluation.run_description import MADE_BY
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite, identity
from fpg_bench.players.agent import agents_named, is_shipped
from fpg_bench.players.planner import PLANNERS, as_planner, asks_language_model
from fpg_bench.players.player import Abilities, Player, PlayerSpec
from fpg_bench.players.registry import card_of, player_name, policy_hash
from fpg_bench.players.remote import is_remote, pinned

ALL_SCRIPTED = "all-scripted"
MADE = "2:"  # begins what is kept of how an agent was made; version 0.2.0 hashed other text
# A player with a name of one's own; parentheses hold no sign of equality, as those of alternate(centres=3)
_NAMED = re.compile(r"((?:[^=/\\:()]|\([^=()]*\))+)=(.+)", re.DOTALL)
_NAMELESS = "object "  # a fingerprint that holds as long as the program runs


@dataclass(frozen=True)
class EvaluatedPlayer:
    """Player that is evaluated: a script, a planner, or one training seed of an agent.

    Attributes:
        name: its name in records and tables; agents of several training seeds share it.
        training_seed: None for a script or a planner.
        fingerprint: hash of the policy or of the code, or the name of a script.
        make: returns the player (or planner) that meets a rival.
        made: hash of all that made an agent except its training seed; None for all else.
        training: training steps and seconds of an agent, as far as they are known.
        elsewhere: True if an agent's training had other rules than the suite.
        is_search: True for a table found by search.
        is_code: True for code, of which the fingerprint need not cover all that decides how it plays.

    Raises:
        UserError: a name that no record can hold.
    """

    name: str
    training_seed: int | None
    fingerprint: str
    make: Callable[[Rival], PlayerSpec | PlannerSpec]
    made: str | None = None
    training: dict[str, float] = dataclasses.field(default_factory=dict)
    elsewhere: bool = False
    is_search: bool = False
    is_code: bool = False

    def __post_init__(self) -> None:
        parse(Word, self.name, "name")  # no record could hold another


def player_entry(
    spec: PlayerSpec, name: str | None = None, training_seed: int | None = None
) -> EvaluatedPlayer:
    """Return the entry of a single player, given by its name or as an object."""
    named = player_name(spec)
    fingerprint = policy_hash(spec) or code_fingerprint(identity(named) if isinstance(spec, str) else named)
    return EvaluatedPlayer(name or named, training_seed, fingerprint, FixedPlayer(spec))


def entries_of(specs: Sequence[PlayerSpec] | Mapping[str, Players], suite: Suite) -> list[EvaluatedPlayer]:
    """Return the entries of players, one per training seed.

    Agents are training seeds of one entry where all that made them is the same but the seed: algorithm,
    hyper-parameters, budget, id, scenario and whom they trained against. Entries of one algorithm that
    differ in these are called by their folders.

    Args:
        specs: players of the suite's side (planners, where it measures these), groups of training seeds
            (``ally-scripted/sac``, ``runs/ppo``), ``all-scripted``, or any of them with a name of one's
            own, ``mine=runs/ppo``. In a mapping, each key names an entry, and its value is a player or a list
            of agents.
        suite: the suite that they will meet.

    Raises:
        UserError: no such player, one of the other side, one that sees the full state, two agents of one
            entry with the same training seed, a name for several entries, or one that is a script's or begins
            with a sign.
    """
    given: dict[str, list[PlayerSpec]] = {}
    every: list[PlayerSpec] = []
    if isinstance(specs, str | os.PathLike) or hasattr(specs, "predict"):
        specs = [specs]
    if not of_kind(specs, "players", "a name, a list or a mapping", Iterable):
        raise UserError("players: there are none; name at least one")
    if isinstance(specs, Mapping):
        given = {str(key): list(of) if isinstance(of, list | tuple) else [of] for key, of in specs.items()}
        specs = ()
    for spec in specs:
        if isinstance(spec, str) and (match := _NAMED.fullmatch(spec)) and not os.path.exists(spec):
            given.setdefault(match[1], []).append(match[2])
        else:
            every += _each(spec, suite)
    own = [entry for key, named in given.items() for entry in _named_entry(key, named, suite)]
    players = {spec: _player(spec, suite) for spec in dict.fromkeys(every)}
    groups: dict[str, list[PlayerSpec]] = {}
    for spec, player in players.items():
        groups.setdefault(_made_by(spec, player), []).append(spec)
    names = _names(groups, players, given)
    entries = [*own, *(_entry(spec, players[spec], names[spec], suite) for spec in players)]
    check_seeds(entries)
    return list({(entry.name, entry.training_seed): entry for entry in entries}.values())


def _each(spec: PlayerSpec, suite: Suite) -> Sequence[PlayerSpec]:
    """Return the players that a specification stands for."""
    of_kind(spec, "players", "names or objects with predict", Hashable)
    side, scripts = suite.side, NAMED.get(suite.side, PLANNERS)
    if spec == ALL_SCRIPTED and side == PLANNER:
        return [name for name in PLANNERS if not asks_language_model(name)]
    if spec == ALL_SCRIPTED:
        return SCRIPTED[side] if suite.game is None else suite.game.scripts[side]
    if is_remote(spec):
        return [pinned(spec)]
    name = os.fspath(spec) if isinstance(spec, str | os.PathLike) else ""
    named = agents_named(name, side) if name and ":" not in name and name not in scripts else [name]
    return [spec] if named == [name] else named


def _named_entry(name: str, specs: list[PlayerSpec], suite: Suite) -> list[EvaluatedPlayer]:
    """Return the entry of this name, one per training seed."""
    if specs != [name]:
        check_name(name, suite.side)
    entries = entries_of(specs, suite)
    if len({entry.name for entry in entries}) > 1:
        raise UserError(f"{name}: {' and '.join(entry.name for entry in entries)} are several entries")
    if name not in ORACLES and entries[0].name in ORACLES:
        raise UserError(
            f"{name}={entries[0].name}: tables tell it apart by its name; write {entries[0].name}"
        )
    return [dataclasses.replace(entry, name=name) for entry in entries]


def check_name(name: str, side: str) -> None:
    """Refuse a name for an entry that is a script's, or that a table or a spreadsheet cannot show."""
    if name.casefold() in (*NAMED.get(side, PLANNERS), *ORACLES):
        raise UserError(f"name {name!r}: is a script's; call the agents otherwise")
    title(name, "name: ")


def is_nameless(entry: EvaluatedPlayer) -> bool:
    """Return True if a player is an object that no name tells, such as a model in training."""
    return entry.fingerprint.startswith(_NAMELESS)


def check_kept(entries: Sequence[EvaluatedPlayer]) -> None:
    """Refuse players that a results folder could not recognize again, as they were not named by text."""
    for entry in entries:
        if is_nameless(entry):
            raise UserError(
                f"{entry.name}: a folder keeps records of players by their names; export it as an agent, "
                "name it package.module:object, or leave out the folder"
            )


def check_seeds(entries: Sequence[EvaluatedPlayer]) -> None:
    """Refuse two players of one entry and training seed, and one policy as several training seeds."""
    known: dict[str, dict[int | None, str]] = {}
    for entry in entries:
        policies = known.setdefault(entry.name, {})
        if policies.setdefault(entry.training_seed, entry.fingerprint) != entry.fingerprint:
            seed = "" if entry.training_seed is None else f" of training seed {entry.training_seed}"
            raise UserError(f"{entry.name}: two different players{seed}; give each a name: NAME=PLAYER")
    check_distinct(known)


def check_distinct(entries: Mapping[str, Mapping[int | None, str]]) -> None:
    """Refuse entries, given by policies' hashes, that are alike in name, or of one policy as several."""
    known: dict[str, str] = {}
    for name, policies in entries.items():
        if (other := known.setdefault(name.casefold(), name)) != name:
            raise UserError(f"{name}: differs from {other} by case alone; give one another name: NAME=PLAYER")
        for line in same_policies(policies):
            raise UserError(f"{name}: {line}")


def same_policies(policies: Mapping[int | None, str]) -> Iterator[str]:
    """Yield a line on each training seed whose policy, given by its hash, is that of an earlier one."""
    first: dict[str, int | None] = {}
    for seed, policy in policies.items():
        if (same := first.setdefault(policy, seed)) != seed:
            rule = "each seed must be a separate training run"
            yield f"seed_{seed}: holds the same policy as seed_{same}; {rule}"


def _player(spec: Any, suite: Suite) -> Any:
    if suite.side == PLANNER:
        if asks_language_model(spec):
            raise UserError(f"planner {spec}: its answers are kept by its own name; write {spec}")
        return as_planner(spec, suite.scenario)
    player = suite.as_player(spec, suite.side, suite.scenario)
    is_oracle = isinstance(spec, str) and spec in ORACLES
    if (Abilities.of(player).sees_state and not is_oracle) or hasattr(player, "join"):
        raise UserError(f"{suite.side} {spec!r}: sees the full state, which no suite allows")
    return player


def _made_by(spec: PlayerSpec, player: Player) -> str:
    """Return a key that agents of one entry share; any other player is an entry of its own."""
    card = card_of(player)
    alone = spec if isinstance(spec, str) else f"{_NAMELESS}{id(spec)}"
    if card is None:
        return alone
    if card.recipe is not None:  # of champions; each seed has responders of its own
        return json.dumps(card.recipe, sort_keys=True)
    content = card.to_dict()
    return json.dumps([content.get(key) for key in MADE_BY], sort_keys=True)


def _names(
    groups: Mapping[str, Sequence[PlayerSpec]], players: Mapping[PlayerSpec, Player], given: Collection[str]
) -> dict[PlayerSpec, str]:
    """Return the name of each player; ``given`` are names of others."""
    first = []
    for members in groups.values():
        card = card_of(players[members[0]])
        first.append(player_name(members[0]) if card is None else card.algorithm)
    folders = [list(map(player_name, members)) for members in groups.values()]
    named: dict[PlayerSpec, str] = {}
    for old, new, members in zip(first, distinct_names(first, folders, given), groups.values(), strict=True):
        is_marked = new != old and is_shipped(player_name(members[0]))
        named |= dict.fromkeys(members, f"{new} (shipped)" if is_marked else new)
    return named


def distinct_names(
    names: Sequence[str], folders: Sequence[Sequence[str]], taken: Collection[str] = ()
) -> list[str]:
    """Return the names of groups of training seeds; those that would share one are named by their folders.

    Names that differ by case alone are the same. ``taken`` are names of others.

    >>> distinct_names(["ppo", "PPO", "sac"], [["runs/slow_0", "runs/slow_1"], ["runs/ppo/seed_0"], ["sac"]])
    ['runs/slow', 'runs/ppo', 'sac']
    """
    named = list(names)
    for rename in (_label, lambda members: members[0]):
        counts = Counter(map(str.casefold, (*named, *taken)))
        named = [
            rename(members) if counts[name.casefold()] > 1 else name
            for name, members in zip(named, folders, strict=True)
        ]
    return named


def _label(folders: Sequence[str]) -> str:
    """Return the common beginning of agents' folders, without the training seed."""
    shared = os.path.commonprefix(  # noqa: RUF071  runs/ppo_ of runs/ppo_0 and runs/ppo_1
        [re.sub(r"(/seed_\d+)?(/agent)?/?$", "", folder) for folder in folders]
    )
    return shared.rstrip("/_-.") or folders[0]


def _entry(spec: PlayerSpec, player: Player, name: str, suite: Suite) -> EvaluatedPlayer:
    card = card_of(player)
    if card is None:
        is_named = isinstance(spec, str | os.PathLike)
        code = code_of(suite.side, player_name(spec)) if is_named else f"{_NAMELESS}{id(spec)}"
        return EvaluatedPlayer(name, None, code_fingerprint(code), FixedPlayer(spec), is_code=is_code(code))
    # An agent itself is sent to workers, as other machines may lack its files; other players by their names.
    made = MADE + hashlib.sha256(_made_by(spec, player).encode()).hexdigest()[:16]
    cost = {"steps": card.played_steps, "seconds": card.seconds}
    training = {key: value for key, value in cost.items() if value is not None}
    return EvaluatedPlayer(
        name,
        card.training_seed,
        card.policy_sha256,
        FixedPlayer(player),
        made,
        training,
        elsewhere=not card.fits(suite.scenario),
        is_search=card.is_search,
    )


@dataclass(frozen=True)
class FixedPlayer:
    """Factory that returns the same player for every rival; unlike a closure it can be pickled."""

    player: PlayerSpec | PlannerSpec

    def __call__(self, rival: Rival) -> PlayerSpec | PlannerSpec:
        """Return the player."""
        return self.player
