"""Fixed players that responses answer, and what their training seeds keep against one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import NAMED, other_side, policy_env
from fpg_bench.common.rows import Row
from fpg_bench.evaluation.play import SeedSource
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.game.spec import GameSpec, Options
from fpg_bench.players.agent import agents_named, read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player, card_of
from fpg_bench.products.league.evaluation import evaluate_against

# Reward of best responses by the side of the player: an ally's lowest return is what anybody can do to it, an
# opponent's is taken against allies that play for themselves.
RESPONSE_REWARDS = {"ally": "zero_sum", "opponent": "own"}


@dataclass(frozen=True)
class ResponseTarget:
    """A fixed player that responses answer, and the game of their training."""

    agent: str
    game: GameSpec

    @property
    def side(self) -> str:
        """The side of the player."""
        return self.game.config.other_side

    @property
    def scenario(self) -> Scenario:
        """The scenario that is played."""
        return self.game.resolve()

    def kept(self, seed: str, response: str, matches: int, seeds: SeedSource | None = None) -> Row:
        """Return what a training seed keeps per step against a response, with its 95 % interval over matches.

        Args:
            seed: the player, or another training seed of it.
            response: the response.
            matches: their number.
            seeds: see :func:`fpg_bench.products.league.evaluation.evaluate_against`.
        """
        of = evaluate_against(seed, {"it": response}, self.side, self.scenario, matches, seeds).reward
        return {"return": round(of.value, 4), "low": round(of.low, 4), "high": round(of.high, 4)}


def find_target(agent: str, side: str | None, replaced: Mapping[str, Any]) -> ResponseTarget:
    """Load a player; the game is that of its training, except for the options that are replaced."""
    side = _side_of(agent) if side is None else one_of(side, "side", SIDES)
    player = as_player(agent, side, STANDARD)
    options: Options = {"path": "pursuit"}
    if (card := card_of(player)) is not None:
        options["path"] = card.flies
        if replaced.get("scenario") is None:
            options["scenario"] = _scenario_of(agent, card)
        else:
            kept = ("knowledge", "jamming_types")
            options |= {name: getattr(card.game, name) for name in kept}
    options |= {name: value for name, value in replaced.items() if value is not None}
    return ResponseTarget(agent, GameSpec.of(policy_env(other_side(side)).id, against=agent, **options))


def _scenario_of(agent: str, card: AgentCard) -> Scenario | str | None:
    """Return the scenario of an agent's training, by the name of its preset if it has one."""
    try:
        home = card.home()
    except UserError as error:
        raise UserError(f"agent {agent}: {error}") from error
    return None if home == STANDARD else home.name or home


def _side_of(agent: str) -> str:
    """Return the side that an agent or a script plays."""
    sides = [side for side in SIDES if agent in NAMED[side]]
    if "/" in agent or Path(agent).is_dir():
        sides = [read_card(agent).side]
    if len(sides) != 1:
        if sides:
            raise UserError(f"player {agent!r} plays both sides; set side to ally or opponent")
        hint = nearest(agent, [name for side in SIDES for name in NAMED[side]])
        raise UserError(f"player {agent!r}: no such agent or script{hint}")
    return sides[0]


def training_seeds(agent: str, side: str | None) -> list[str]:
    """Return all training seeds of the group that an agent belongs to, or that is named; else the player."""
    group, _, last = agent.rstrip("/").removesuffix("/agent").rpartition("/")
    is_seed = bool(group) and last.startswith("seed_")
    seeds = agents_named(group if is_seed else agent, side or "ally")
    return seeds if agent in seeds or not is_seed else [agent]
