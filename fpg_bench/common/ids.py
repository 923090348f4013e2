"""Environment ids and their defaults, and the names of scripts. Importing this module is cheap."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from fpg_bench.common.errors import UserError, nearest


@dataclass(frozen=True)
class EnvConfig:
    """Configuration of one id: the learning side, the other side's player, the opponent's path.

    ``scripted`` says that the other side must be a script; ``planner`` is set where the opponent flies
    what a path planner says, over ``rounds_per_match`` rounds.
    """

    id: str
    side: str
    other: str
    path: str = "pursuit"
    planner: str | None = None
    rounds_per_match: int = 1
    scripted: bool = True
    about: str = ""

    @property
    def other_side(self) -> str:
        """The keyword of the other side's player: ``opponent`` or ``ally``."""
        return "opponent" if self.side == "ally" else "ally"


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


DUEL = "FPG/duel_v0"
ALLIES = ("idle", "random", "reactive", "expert", "expert-spread", "always-hop")
OPPONENTS = ("tone", "narrowband", "broadband", "comb", "random", "sweep", "adaptive", "watchful")
SCRIPTED = {"ally": ALLIES, "opponent": OPPONENTS}


def policy_env(side: str) -> EnvConfig:
    """Return the environment in which a side plays against any player."""
    return next(config for config in ENVS.values() if config.side == side and not config.scripted)


def sides_of(name: str) -> tuple[str, ...]:
    """Return the sides that the caller plays in an id: one, or both in the duel.

    Raises:
        UserError: no such id.
    """
    return ("ally", "opponent") if _plain(name) == DUEL else (find_env(name).side,)


def find_env(name: str) -> EnvConfig:
    """Return the configuration of an id, with or without the prefix ``fpg_bench:``.

    Raises:
        UserError: no such id; the message suggests the nearest.
    """
    name = _plain(name)
    if name not in ENVS:
        raise UserError(f"unknown id {name!r}{nearest(name, ENVS)}")
    return ENVS[name]


def _plain(name: str) -> str:
    return str(name).removeprefix("fpg_bench:")
