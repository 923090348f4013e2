"""Registry of players: a name is a script, an oracle, an agent, a folder, or an object to import.

Models of other spaces become players of the 15 numbers and nine floats.
"""

from __future__ import annotations

import contextlib
import os
import re
from functools import partial

import numpy as np
from gymnasium import spaces

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import ALL_TACTICS, NAMED, ORACLES, action_modes, other_side
from fpg_bench.common.imports import import_object, names_object, ready
from fpg_bench.common.products import load, offered
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import OtherGame, other_game
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.game.waterfall import Waterfall
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import Memory, Player, PlayerSpec, Prediction
from fpg_bench.players.preprocessing import (
    Preprocessing,
    check_difference,
    core_of,
    difference_in_own_games,
    preprocessing_of,
    takes_masks,
    unknown,
)
from fpg_bench.players.remote import is_remote
from fpg_bench.players.scripted import player_noise
from fpg_bench.players.seeded import Seeded
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
        scenario: the rules of the game.

    Raises:
        UserError: no such player, one that cannot be made, not one of this side, one of a team, or a model of
            other choices.
    """
    player = any_player(spec, side, scenario)
    if getattr(player, "sees", "") not in ("", "state"):  # of another game than the duel
        raise UserError(f"{side} {player_name(spec)}: plays a seat of a team, not a duel")
    return player


def any_player(spec: PlayerSpec, side: str, scenario: Scenario) -> Player:
    """Return the player that ``spec`` names, also one of a seat of a team; else as :func:`as_player`."""
    if not isinstance(spec, str | os.PathLike):
        if callable(getattr(spec, "predict", None)):
            return _adapted(spec, side, scenario)
        raise UserError(f"{side}: expected a player's name or an object with predict, got {spec!r}")
    name = os.fspath(spec)
    if variant := _VARIANT.fullmatch(name):
        return _script_with(variant[1], variant[2], side, scenario)
    if name in offered(side):
        make = partial(load(side, name), side, name)
        offer: Player = ready(make, f"{side} {name!r}", ("predict",), scenario)
        return offer
    if name.startswith("suite:"):
        from fpg_bench.players.agent import load_member

        return load_member(name, side)
    if _is_agent(name, side):
        from fpg_bench.players.agent import load_agent

        return load_agent(name, side)
    if names_object(name):
        player: Player = import_object(name, side, ("predict",), scenario)
        return player
    if name in NAMED[other_side(side)]:
        raise _of_other_side(name, side)
    from fpg_bench.players.agent import agent_folder, baselines_folder

    if name and os.path.isdir(baselines_folder() / "agents" / name):
        agent_folder(name)  # says which agents the group has
    raise UserError(f"unknown {side} {name!r}{nearest(name, [*NAMED[side], *ORACLES])}")


def _script_with(name: str, values: str, side: str, scenario: Scenario) -> Tactic:
    """Return a script with the constants of a text such as ``centres=3, hold_s=2``."""
    if name in NAMED[other_side(side)]:
        raise _of_other_side(name, side)
    if name not in ALL_TACTICS[side]:
        known = ", ".join(ALL_TACTICS[side])
        raise UserError(
            f"{side} {name!r} has no constants{nearest(name, ALL_TACTICS[side])}; these have: {known}"
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


def card_of(player: object) -> AgentCard | None:
    """Return the card of an agent; None for any other player."""
    card = getattr(player, "card", None)
    return card if isinstance(card, AgentCard) else None


def policy_hash(player: object) -> str | None:
    """Return the SHA-256 of an agent's policy; None for any other player."""
    card = card_of(player)
    return None if card is None else card.policy_sha256


def named_card(spec: PlayerSpec, side: str) -> AgentCard | None:
    """Return the card of the agent that a specification names, without its policy; None for other players.

    Raises:
        UserError: no such agent, one without a valid card, or one of the other side.
    """
    if not isinstance(spec, str | os.PathLike):
        return card_of(spec)
    name = os.fspath(spec)
    if name.startswith("suite:"):
        from fpg_bench.players.agent import member_folder

        name = member_folder(name, side)
    elif not _is_agent(name, side):
        return None
    from fpg_bench.players.agent import read_card

    return read_card(name)


def trained_game(spec: PlayerSpec, side: str) -> OtherGame | None:
    """Return the game that an agent was trained in, if it is not the duel; raises as :func:`named_card`."""
    card = named_card(spec, side)
    return None if card is None else other_game(card.game)


def _is_agent(name: str, side: str) -> bool:
    """Return True if a name is that of an agent or a folder."""
    if _VARIANT.fullmatch(name) or name in NAMED[side] or name in ORACLES:
        return False
    is_path = bool({"/", "\\"} & set(name)) or os.path.isdir(name)
    return is_remote(name) or (is_path and not names_object(name))


def player_name(spec: PlayerSpec) -> str:
    """Return the name of a player in rows and tables: its specification, or its class."""
    return os.fspath(spec) if isinstance(spec, str | os.PathLike) else type(spec).__name__


class ModelPlayer(Seeded):
    """Player of a model that sees more than the 15 numbers, predicts choices as SB3's DQN does, or both.

    Args:
        model: anything with ``predict``; its answers are floats ``(n, 9)`` or, with choices, whole numbers,
            ``(n,)`` or ``(n, lists)``.
        choices: the choices that it picks from; None: continuous actions.
        preprocessing: what makes its observations of the 15 numbers.
    """

    def __init__(self, model: Player, choices: Choices | None, preprocessing: Preprocessing) -> None:
        self.model, self._choices, self._preprocessing = model, choices, preprocessing
        self._mask = choices.mask if choices and takes_masks(model) and not choices.mask.all() else None

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        steps = np.zeros(len(seen), np.int64)
        stack, state, steps = (None, None, steps) if state is None else state
        if starts is not None:
            steps = np.where(starts, 0, steps)
        stack = self._preprocessing.pushed(stack, seen, starts)
        masks: dict[str, np.ndarray] = {}
        if self._mask is not None:
            masks["action_masks"] = np.tile(self._mask, (len(seen), 1))
        actions, state = self.model.predict(self._preprocessing.shown(stack), state, starts, True, **masks)
        if self._choices is not None:
            noise = player_noise(self.keys(len(seen)), steps) if self._choices.is_drawn else None
            actions = self._choices.decode(np.asarray(actions), seen, noise=noise)
        return actions, (stack, state, steps + 1)


def _adapted(player: Player, side: str, scenario: Scenario) -> Player:
    """Return a player of the 15 numbers and nine floats: a model's export, the player, or a wrapper of it."""
    choices = _choices(player, side, scenario)
    preprocessing = preprocessing_of(player, _waterfall(player, side, scenario))
    if preprocessing.size != OBSERVATION_SIZE:
        raise UserError(
            f"{side} {type(player).__name__}: plays a seat of a team, which draws its actions; make it an "
            "agent with fpg_bench.export_agent"
        )
    if unknown(player):
        check_difference(player, _difference_in_own_games(player))
    if callable(getattr(player, "get_env", None)):  # of Stable-Baselines3
        own = choices if core_of(player) is None else None
        with contextlib.suppress(UserError):  # not all are written, nor play as their networks alone
            exported: Player = load("agent", "live")(player, own)
            return exported
    if choices is None and not preprocessing.is_needed:
        return player
    return ModelPlayer(player, choices, preprocessing)


def _difference_in_own_games(model: Player) -> float | None:
    """Return how far a model plays from its own player in its own games; None if they cannot be played."""
    if (core := core_of(model)) is None:
        return None
    own = ModelPlayer(model, core.choices, preprocessing_of(model, core.waterfall))
    return difference_in_own_games(model, own, core.choices)


def _choices(player: Player, side: str, scenario: Scenario) -> Choices | None:
    """Return what a model chooses from, by its ``action_space``; no two modes have lists of equal sizes."""
    space = getattr(player, "action_space", None)
    if isinstance(space, spaces.MultiDiscrete):
        sizes = tuple(space.nvec.tolist())
    elif isinstance(space, spaces.Discrete):
        sizes = (int(space.n),)
    else:
        return None
    every = [Choices(side, mode, scenario) for mode in action_modes(side) if mode != "continuous"]
    alike = [choices for choices in every if choices.is_multi == (len(sizes) > 1)]
    for choices in alike:
        if choices.sizes == sizes:
            return choices
    known = ", ".join(f"{choices.sizes} (actions={choices.mode!r})" for choices in alike)
    raise UserError(f"{side}: {type(player).__name__} chooses from {sizes}, the {side} here from {known}")


def _waterfall(player: Player, side: str, scenario: Scenario) -> Waterfall | None:
    """Return the waterfall that a model sees, by its ``observation_space``."""
    space, core = getattr(player, "observation_space", None), core_of(player)
    if (
        not isinstance(space, spaces.Box)
        or len(space.shape) != 2
        or (core is not None and core.waterfall is None)
    ):
        return None
    waterfall = Waterfall(scenario, space.shape[0])
    if side != "ally" or space.shape != waterfall.shape:
        seen = f"a waterfall of {waterfall.shape}" if side == "ally" else "15 numbers"
        raise UserError(f"{side}: {type(player).__name__} sees {space.shape}, the {side} here {seen}")
    return waterfall
