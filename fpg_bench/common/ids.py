"""Environment ids and their defaults, and the names of players. Importing this module is cheap."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from types import MappingProxyType

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.products import offered


def other_side(side: str) -> str:
    """Return the rivals' side of ``ally``, ``opponent`` or ``planner``."""
    return "opponent" if side == "ally" else "ally"


FIRST_VERSION = ("Initial release, in fpg-bench 0.1.0",)  # of ids that had no other version


@dataclass(frozen=True)
class EnvConfig:
    """Configuration of one id: the learning side, the other side's player, the opponent's path.

    ``scripted`` says that the other side must be a script; ``planner`` is set where the opponent flies
    what a path planner says, over ``rounds_per_match`` rounds; ``actions`` is the action mode. ``versions``
    says what each version of the id changed, from v0 on.
    """

    id: str
    side: str
    other: str
    path: str = "pursuit"
    planner: str | None = None
    rounds_per_match: int = 1
    scripted: bool = True
    about: str = ""
    actions: str = "continuous"
    versions: tuple[str, ...] = FIRST_VERSION

    @property
    def other_side(self) -> str:
        """The keyword of the other side's player: ``opponent`` or ``ally``."""
        return other_side(self.side)

    def action_mode(self, actions: str | None) -> str:
        """Return the action mode of the caller, otherwise the id's; raises UserError if they differ."""
        if actions not in (None, self.actions) and self.actions != "continuous":
            raise UserError(f"actions: the id says {self.actions}, got {actions!r}; use {self.id} to choose")
        return self.actions if actions is None else actions


ENVS = MappingProxyType(
    {
        config.id: config
        for config in (
            EnvConfig(
                "FPG/AllyVsScripted-v0", "ally", "adaptive", about="keep the link against a scripted jammer"
            ),
            EnvConfig(
                "FPG/AllyVsPlanner-v0",
                "ally",
                "adaptive",
                path="waypoints",
                planner="interceptor",
                rounds_per_match=10,
                about="keep the link against a jammer whose path is planned between rounds",
            ),
            EnvConfig(
                "FPG/AllyVsLLM-v0",
                "ally",
                "adaptive",
                path="waypoints",
                planner="llm",
                rounds_per_match=10,
                about="the same against a large language model that plans the path; needs an endpoint",
            ),
            EnvConfig(
                "FPG/OpponentVsScripted-v0", "opponent", "expert", about="find and jam a scripted ally"
            ),
            EnvConfig(
                "FPG/AllyVsPolicy-v0",
                "ally",
                "adaptive",
                scripted=False,
                about="keep the link against any player, a trained one for instance",
            ),
            EnvConfig(
                "FPG/OpponentVsPolicy-v0",
                "opponent",
                "expert",
                scripted=False,
                about="find and jam any player, a trained one for instance",
            ),
        )
    }
)


# Action modes, and what an id has in its name that is registered for each: FPG/AllyVsScriptedDiscrete-v0.
ACTION_MODES = {
    "continuous": "",
    "discrete": "Discrete",
    "multi-discrete": "MultiDiscrete",
    "discrete-uniform": "DiscreteUniform",
    "uniform-hop": "UniformHop",
}
ALLY_MODES = ("discrete-uniform", "uniform-hop")  # the opponent does not hop
_MODE = re.compile(rf"(FPG/\w+?)({'|'.join(filter(None, ACTION_MODES.values()))})-v0")
DUEL = "FPG/duel_v0"
ALLIES = ("idle", "random", "reactive", "expert", "expert-spread", "always-hop")
OPPONENTS = ("tone", "narrowband", "broadband", "comb", "random", "sweep", "adaptive", "watchful")
TACTICS = {
    "ally": ("sulk", "by-type"),
    "opponent": ("scan", "alternate", "guard", "herd"),
}  # with constants to change
# Newer than all-scripted.
LATER_TACTICS = {"ally": ("evidence", "clock", "range"), "opponent": ("hunter", "split")}
ALL_TACTICS = {side: (*TACTICS[side], *LATER_TACTICS[side]) for side in TACTICS}
# What all-scripted stands for, and what searches and self-play begin with: frozen, as results name them.
SCRIPTED = {"ally": (*ALLIES, *TACTICS["ally"]), "opponent": (*OPPONENTS, *TACTICS["opponent"])}
ORACLES = ("oracle",)  # of either side; they see the full state, and tables tell them apart
# All players that are offered by name but oracles, and the scripts among them.
NAMED = {side: tuple(name for name in offered(side) if name not in ORACLES) for side in SCRIPTED}
SCRIPTS = {
    side: tuple(name for name in names if offered(side)[name].group == "scripts")
    for side, names in NAMED.items()
}


def policy_env(side: str) -> EnvConfig:
    """Return the environment in which a side plays against any player."""
    return next(config for config in ENVS.values() if config.side == side and not config.scripted)


def sides_of(name: str) -> tuple[str, ...]:
    """Return the sides that the caller plays in an id: one, or both in the duel.

    Raises:
        UserError: no such id.
    """
    return ("ally", "opponent") if plain_id(name) == DUEL else (find_env(name).side,)


def find_env(name: str) -> EnvConfig:
    """Return the configuration of an id, with or without the prefix ``fpg_bench:``.

    An id of discrete actions, ``FPG/AllyVsScriptedDiscrete-v0``, has the configuration of the plain id with
    another action mode.

    Raises:
        UserError: no such id; the message suggests the nearest.
    """
    name, actions = plain_id(name), "continuous"
    if match := _MODE.fullmatch(name):
        name = f"{match[1]}-v0"
        actions = next(mode for mode, word in ACTION_MODES.items() if word == match[2])
    if name not in ENVS or actions not in action_modes(ENVS[name].side):
        raise UserError(f"unknown id {name!r}{nearest(name, registered_ids())}")
    return replace(ENVS[name], actions=actions)


def action_modes(side: str) -> tuple[str, ...]:
    """Return the action modes of a side."""
    return tuple(mode for mode in ACTION_MODES if side == "ally" or mode not in ALLY_MODES)


def registered_ids() -> list[str]:
    """Return all ids that Gymnasium registers: each in the action modes of its side."""
    return [id_with(name, mode) for name, config in ENVS.items() for mode in action_modes(config.side)]


def id_with(env_id: str, actions: str) -> str:
    """Return the id that is registered for a plain id in an action mode."""
    return env_id.replace("-v0", f"{ACTION_MODES[actions]}-v0")


def plain_id(name: str) -> str:
    """Return an id without the prefix ``fpg_bench:``."""
    return str(name).removeprefix("fpg_bench:")
