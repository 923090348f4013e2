"""The game that is played: an environment id and its options, as one value that can be written down."""

from __future__ import annotations

import abc
import dataclasses
import hashlib
import json
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NoReturn, Protocol

from fpg_bench.common.checks import check_keys, integer, mapping, of_kind, one_of
from fpg_bench.common.errors import UnknownOptionError, UserError, nearest
from fpg_bench.common.ids import ACTION_MODES, DUEL, SCRIPTED, EnvConfig, action_modes, find_env, plain_id
from fpg_bench.common.imports import check_allowed, code_named, split_weight
from fpg_bench.common.products import load, offered
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.scenario import PRESETS, Scenario, ScenarioLike, as_scenario
from fpg_bench.game.state import OBSERVATION_SIZE

REWARDS = ("own", "zero_sum", "jamming", "overlap", "ally_cost")
OBSERVATIONS = ("numbers", "waterfall")
_SIDES = ("ally", "opponent")
_MOST_WEIGHT = 1000
LISTS = (*_SIDES, "path", "jamming_types")  # options that take one name or several
_NAMES = ("planner", "knowledge", "reward", "observation")
_ONE_SIDED = (*_SIDES, "reward", "observation", "history")  # options that the duel does not have
_FIRST = ("side", "actions")  # options by which others are understood

Options = dict[str, Any]  # of a game, by name; in Python some are objects


@dataclass(frozen=True)
class GameSpec:
    """Specification of a game, as :class:`gymnasium.envs.registration.EnvSpec` is one of an environment.

    An option that is None has the default of the id. Environments give their specification back as
    ``game_spec``, runs and agents store it as JSON, and :func:`fpg_bench.make_sb3` opens it again:

    >>> spec = GameSpec("FPG/AllyVsScripted-v0", opponent="sweep", path="circle")
    >>> spec.to_dict()
    {'id': 'FPG/AllyVsScripted-v0', 'opponent': 'sweep', 'path': 'circle'}
    >>> GameSpec.from_dict(spec.to_dict()) == spec
    True

    Attributes:
        id: environment id; one that names an action mode is kept as the plain id and ``actions``.
        scenario: the scenario: ``standard``, ``paper``, ``figures``, ``link``, a variant such as
            ``link-fast-hop``, or a YAML file. Of several, one is drawn per round. In Python also a
            :class:`Scenario`, or a mapping of fields, in which ``[low, high]`` is a range to draw from. None:
            ``standard``.
        opponent, ally: the other side's player: a script, a shipped agent, an agent's folder,
            ``hf://owner/name`` or ``package.module:object`` (see ``fpg-bench players``), or ``suite:NAME``
            for all members of a suite. Of several, one is drawn per round; ``tone*8`` stands for eight times
            ``tone``, which is drawn as often. In Python also objects with ``predict``, in ids against any
            player.
        path: the opponent's flight path. Of several, one is drawn per round.
        planner: the planner of the opponent's path between rounds, by name or ``package.module:object``. In
            Python also an object, or a function or class that makes one and may take the scenario.
        knowledge: the ally's knowledge base: ``expert``, ``none`` or a YAML file.
        jamming_types: allowed jamming types.
        reward: reward of the learner: ``own``, ``zero_sum``, ``jamming``, ``overlap`` or ``ally_cost``;
            None: ``own``. See :func:`fpg_bench.envs.core.compute_reward`.
        actions: action mode: ``continuous``, ``discrete`` or ``multi-discrete``, or, of the ally,
            ``discrete-uniform`` or ``uniform-hop``; None: that of the environment. Of the duel also a
            mapping from sides to modes.
        observation: what the ally sees: its 15 ``numbers`` or a spectrum ``waterfall``; None: ``numbers``.
        history: rows of the waterfall; None: 16.
        untrusted: the ``package.module:object`` and agents of the Hub that a file named and the user has not
            allowed. A game that has such a player or planner is not opened.

    Raises:
        UserError: no such id, action mode, reward or observation, an action mode that contradicts the id,
            or an option that the duel lacks.
    """

    id: str
    scenario: Scenario | str | Mapping[str, Any] | Sequence[ScenarioLike] | None = None
    opponent: Any = None
    ally: Any = None
    path: Any = None
    planner: Any = None
    knowledge: str | None = None
    jamming_types: Any = None
    reward: str | None = None
    actions: str | Mapping[str, str] | None = None
    observation: str | None = None
    history: int | None = None
    untrusted: frozenset[str] = dataclasses.field(default=frozenset(), compare=False, repr=False)

    def __post_init__(self) -> None:
        changes: Options = {"id": plain_id(self.id)} | self._checked()
        if self.history is not None:
            changes["history"] = integer(self.history, "history")
        for name in LISTS:
            changes[name] = _listed(name, getattr(self, name))
        if isinstance(self.scenario, list | tuple | Mapping):
            changes["scenario"] = as_scenario(self.scenario)
        for name in ("scenario", "knowledge"):
            if isinstance(value := getattr(self, name), os.PathLike):
                changes[name] = os.fspath(value)
        for name, value in changes.items():
            object.__setattr__(self, name, value)

    def _checked(self) -> Options:
        """Check the options that depend on the id, and return those that are kept in another form."""
        if self.is_duel:
            self._check_lacks(_ONE_SIDED, f"in {DUEL} you play both sides")
            return {}
        config = self.config
        mode = config.action_mode(self.actions)  # type: ignore[arg-type]  # refuses a mapping
        for name, value, known in (
            (f"actions of the {config.side}", mode, action_modes(config.side)),
            ("reward", self.reward, REWARDS),
            ("observation", self.observation, OBSERVATIONS),
        ):
            if value is not None:
                one_of(value, name, known)
        return {"id": config.id, "actions": None if mode == "continuous" else mode}

    def _check_lacks(self, names: Collection[str], reason: str) -> None:
        """Raise UnknownOptionError, with a reason, if one of these options is set."""
        if given := next((name for name in names if getattr(self, name) is not None), None):
            raise UnknownOptionError(f"got an unexpected keyword argument {given!r}: {reason}")

    @classmethod
    def of(
        cls, game: str | GameSpec, *, against: Any = None, allow: Collection[str] = (), **options: Any
    ) -> GameSpec:
        """Return the specification of an id, or another one with some options replaced.

        Args:
            game: an environment id, or a specification.
            against: the other side's player or players, whichever side that is.
            allow: the ``package.module:object`` and agents of the Hub that you trust, of those that a file
                named.
            **options: the attributes but ``id`` and ``untrusted``.

        Raises:
            UnknownOptionError: an option that does not exist; the message names the nearest.
            UserError: see the class; also players that are named twice, or in the duel.
        """
        kind = type(game) if isinstance(game, GameSpec) else kind_of(game)
        if unknown := next((name for name in options if name not in option_names(kind)), None):
            others = [id for id in offered("game") if unknown in option_names(kind_of(id))]
            hint = f": only {others[0]} has it" if others else nearest(unknown, option_names(kind))
            raise UnknownOptionError(f"got an unexpected keyword argument {unknown!r}{hint}")
        if not isinstance(game, GameSpec):
            game = kind(game, **{name: options.pop(name) for name in _FIRST if name in options})
        game = dataclasses.replace(game, **options)
        if against is not None:
            if game.id == DUEL:
                raise UserError(f"against: in {DUEL} both sides learn; omit it")
            other = game.config.other_side
            if getattr(game, other) is not None:
                raise UserError(f"against: names the {other}, and so does {other}; give only one of them")
            options[other] = against
        untrusted = game.untrusted.difference(allow, code_named(options))  # what the caller names is meant
        return dataclasses.replace(game, **options, untrusted=untrusted)

    def check_trusted(self) -> None:
        """Raise UserError if a player or a planner was named by a file, and its code is not allowed."""
        if self.untrusted:
            named = code_named(self.options())
            check_allowed(named, [name for name in named if name not in self.untrusted], "game")

    @property
    def is_duel(self) -> bool:
        """True if the caller plays both sides."""
        return plain_id(self.id) == DUEL

    @property
    def config(self) -> EnvConfig:
        """Configuration of the id; raises UserError for the duel, which has no other side."""
        return find_env(self.id)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides that the caller plays."""
        return _SIDES if self.is_duel else (self.config.side,)

    @property
    def action_mode(self) -> str:
        """The action mode: that of the ally where the duel's sides have different ones."""
        modes = self.actions or "continuous"
        return modes if isinstance(modes, str) else modes.get("ally", "continuous")

    @property
    def others(self) -> tuple[Any, ...]:
        """The other side's players, in the duel none."""
        if self.is_duel:
            return ()
        players: tuple[Any, ...] | None = getattr(self, self.config.other_side)
        return (self.config.other,) if players is None else players

    def resolve(self) -> Scenario:
        """Return the scenario that is played: the named one with the options and the id's path and rounds.

        Raises:
            UserError: no such scenario, a field out of range, or a path that does not fit the id.
        """
        is_planned = self.planner is not None if self.is_duel else self.config.planner is not None
        path = self.path
        if path is None and (is_planned or (self.scenario is None and not self.is_duel)):
            path = "waypoints" if is_planned else self.config.path
        elif path is not None and is_planned and not self.is_duel and "waypoints" not in path:
            raise UserError("path: an opponent with a planner flies waypoints; choose a planner instead")
        has_own_rounds = self.is_duel or (self.scenario is not None and self.scenario not in PRESETS)
        played = as_scenario(
            self.scenario,
            opponent_path=path,
            knowledge=self.knowledge,
            jamming_types=self.jamming_types,
            rounds_per_match=None if has_own_rounds else self.config.rounds_per_match,
        )
        if "waypoints" in played.paths and not is_planned and not self.is_duel:
            raise UserError(f"path: {self.id} plans no 'waypoints'; FPG/AllyVsPlanner-v0 does")
        return played

    def options(self) -> Options:
        """Return the options that are set, by name; a list of one name is that name."""
        known = option_names(type(self))
        every = [each for each in dataclasses.fields(self) if each.name in known]
        values = {each.name: getattr(self, each.name) for each in every if not self._has_default(each)}
        return {
            name: value[0] if name in LISTS and len(value) == 1 else value for name, value in values.items()
        }

    def _has_default(self, field: dataclasses.Field[Any]) -> bool:
        value = getattr(self, field.name)
        return value is None or (isinstance(value, type(field.default)) and value == field.default)

    def to_dict(self) -> JsonObject:
        """Return the specification as JSON holds it: ``id`` and the options that are set.

        A :class:`Scenario` becomes the name of the preset that equals it, or else the mapping of
        :meth:`Scenario.to_dict`.

        Raises:
            UserError: a player or a planner is an object, which has no name.
        """
        return {"id": self.id, **{name: _as_json(name, value) for name, value in self.options().items()}}

    def describe(self) -> JsonObject:
        """Return :meth:`to_dict`, with an object's ``repr`` where it raises: enough to read, not to open."""
        return {"id": self.id, **{name: _described(name, value) for name, value in self.options().items()}}

    @classmethod
    def from_dict(cls, content: object, where: str = "") -> GameSpec:
        """Return the specification of a mapping that was read from JSON or YAML.

        The code that it names is not trusted: only ``make_sb3(spec, allow=["package.module:object"])`` opens
        such a game.

        Raises:
            UserError: not such a mapping; ``where`` begins the message.
        """
        try:
            content = dict(mapping(content, "game"))
            known = option_names(kind := kind_of(of_kind(content.get("id"), "id", "an environment id", str)))
            if unknown := next((name for name in content if name not in ("id", *known)), None):
                raise UserError(f"unknown key {unknown!r}{nearest(str(unknown), known)}")
            for name, value in content.items():
                _check_json(name, value)
            if isinstance(fields := content.get("scenario"), Mapping):
                content["scenario"] = Scenario.from_dict(fields)
            return kind(**content, untrusted=frozenset(code_named(content)))
        except UserError as error:
            raise UserError(f"{where}: {error}" if where else str(error)) from error

    @property
    def hash(self) -> str:
        """SHA-256 of the game, 64 hexadecimal digits: of its id, options, and the scenario's own hash.

        Raises:
            UserError: as :meth:`to_dict` and :meth:`resolve`.
        """
        content = self.to_dict() | {"scenario": self.resolve().hash}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class OtherGame(GameSpec, abc.ABC):
    """Specification of a game of another kind than the duel, which a product offers.

    The core trains, evaluates and registers such a game by what this class and :class:`GameProduct` declare.
    Its options are the fields of the class, also on the command line.

    Attributes:
        sees: what its players have as attribute ``sees``, which the duel refuses; empty: players of the duel.
        samples: whether exported agents draw their actions; else they play their mode.
        observation_size: size of a player's observation.
        scripts: the scripts of each side that ``all-scripted`` stands for.
        skills: games that an agent trained in this game can play, as its card describes them.
    """

    sees: ClassVar[str] = ""
    samples: ClassVar[bool] = False
    observation_size: ClassVar[int] = OBSERVATION_SIZE
    scripts: ClassVar[Mapping[str, tuple[str, ...]]] = SCRIPTED

    @property
    @abc.abstractmethod
    def suite(self) -> str:
        """Name of the public suite that the caller's side is measured on."""

    @property
    def skills(self) -> JsonObject:
        """Games that an agent trained in this game can play, as its card describes them."""
        return {}

    @classmethod
    def check_skills(cls, skills: JsonObject) -> None:
        """Raise UserError if a card's ``skills`` are not such as this game's agents have."""
        check_keys(skills, (), "skills")

    def like(self, other: GameSpec) -> OtherGame:
        """Return the game with the sizes of another one of its kind, as a suite plays it for a training."""
        return self


class GameProduct(Protocol):
    """Offer ``game`` of a product: the type of the game's specifications, and what opens such a game.

    Attributes:
        spec: type of the specifications.
    """

    spec: type[OtherGame]

    def make_core(self, game: Any, n_envs: int) -> Any:
        """Return the rows of a ``VecEnv``, an :class:`fpg_bench.envs.core.Core`."""

    def make_env(self, render_mode: str | None = None, **options: Any) -> Any:
        """Return the PettingZoo environment whose agents move at once, a ``ParallelEnv``."""

    def make_player(self, spec: Any, side: str, scenario: Scenario, game: Any) -> Any:
        """Return a player of a side, an :class:`fpg_bench.players.player.Player`."""

    def make_match(self, player: Any, suite: Any, rival: Any, count: int) -> Any:
        """Return the :class:`fpg_bench.evaluation.rounds.MatchBatch` in which a player meets a rival."""

    def watch(
        self, ally: Any, opponent: Any, out: Any, *, game: Any, seed: int, every: int
    ) -> dict[str, float | None]:
        """Play a round of two players, print or draw it, and return its measures."""


def game_product(env_id: str) -> GameProduct:
    """Return what opens the games of an id that a product offers."""
    product: GameProduct = load("game", plain_id(env_id))
    return product


def observation_size(game: GameSpec | None) -> int:
    """Return the size of a player's observation; None: of the duel."""
    return game.observation_size if isinstance(game, OtherGame) else OBSERVATION_SIZE


def other_game(game: GameSpec | None) -> OtherGame | None:
    """Return a game that is of another kind than the duel; None for the duel."""
    return game if isinstance(game, OtherGame) else None


def kind_of(env_id: str) -> type[GameSpec]:
    """Return the type of an id's specifications: :class:`GameSpec`, or a product's :class:`OtherGame`."""
    name = plain_id(env_id)
    return game_product(name).spec if name in offered("game") else GameSpec


def option_names(kind: type[GameSpec] = GameSpec) -> tuple[str, ...]:
    """Return the names of all options of games: attributes of their specification, without ``id``."""
    return tuple(each.name for each in dataclasses.fields(kind) if each.name not in ("id", "untrusted"))


def _repeated(players: Any) -> Any:
    """Return players with a weight, ``name*8``, as often as it says; anything else as it is.

    Raises:
        UserError: a weight that is not a whole number from 1 to 1000.
    """
    if isinstance(players, list | tuple):
        parts = [_repeated(player) for player in players]
        return [each for part in parts for each in (part if isinstance(part, list) else [part])]
    if not isinstance(players, str):
        return players
    name, weight = split_weight(players)
    if not 1 <= weight <= _MOST_WEIGHT:
        raise UserError(f"{players}: expected a weight from 1 to {_MOST_WEIGHT}")
    return players if name == players else [name] * weight


def _listed(name: str, value: Any) -> tuple[Any, ...] | None:
    """Return an option of one or several names as a tuple; None stays."""
    if value is None:
        return None
    value = _repeated(value) if name in _SIDES else value
    if isinstance(value, Sequence) and not isinstance(value, str):
        if not value:
            what = "players" if name in _SIDES else name
            raise UserError(f"{name}: a list of {what} to draw from must not be empty")
        return tuple(os.fspath(item) if isinstance(item, os.PathLike) else item for item in value)
    return (os.fspath(value) if isinstance(value, os.PathLike) else value,)


def _as_json(name: str, value: Any) -> Any:
    if isinstance(value, Scenario):
        base = value.base.name
        return value.name or (
            value.to_dict() if base is None else {"preset": base} | value.changes(value.base)
        )
    if isinstance(value, tuple):
        return [_as_json(name, item) for item in value]
    if isinstance(value, Mapping):
        return dict(value)
    if not isinstance(value, str | int | float):
        raise UserError(
            f"{name}: {type(value).__name__} is an object of this program, which cannot be written down; "
            "name it package.module:object, or export it as an agent"
        )
    return value


def _described(name: str, value: Any) -> Any:
    try:
        return _as_json(name, value)
    except UserError:
        return list(map(str, value)) if isinstance(value, tuple) else str(value)


def _check_json(name: str, value: object) -> None:
    """Raise UserError if a value read from JSON is not of an option's kind."""

    def refuse(expected: str) -> NoReturn:
        raise UserError(f"{name}: expected {expected}, got {value!r:.60}")

    if name == "scenario" and not isinstance(value, str | Mapping):
        refuse("a preset, a YAML file or a mapping of fields")
    if name in LISTS:
        items = value if isinstance(value, list | tuple) else [value]
        if not items or not all(isinstance(item, str) for item in items):
            refuse("a name or a list of names")
    if name == "actions":
        for mode in value.values() if isinstance(value, Mapping) else (value,):
            one_of(mode, name, list(ACTION_MODES))
    elif name in _NAMES and not isinstance(value, str):
        refuse("a name")
