"""Search for a short rule against a pool of rivals, within a budget of CPU seconds."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from fpg_bench.common.files import write_json
from fpg_bench.common.ids import SCRIPTS, other_side, policy_env
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import expand_suites
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player, policy_hash
from fpg_bench.products.league.candidates import Candidates, earnings
from fpg_bench.products.league.categorical import CategoricalSearch
from fpg_bench.products.league.config import RuleSearchConfig
from fpg_bench.products.league.folder import run_search, search_folder, write_found
from fpg_bench.products.league.rules import NUMBERS, Option, describe_rule, rule_graph, rule_values

NAME = "rule"  # of its files, and of the algorithm


def rule_search(config: RuleSearchConfig, out: str | Path, *, progress: bool = True) -> Row:
    """Search a rule of a side against a pool of rivals.

    The rows of a search depend on its seed alone, and its budget decides how many there are. A stopped call
    is resumed, and a larger budget continues a finished one.

    Args:
        config: the side, the rivals and the goal.
        out: a folder for ``rule.jsonl``, a row per generation; ``agent``, the rule as an agent; and
            ``rule.json``, the settings and the result.
        progress: log a line for each quarter of the budget.

    Returns:
        The content of ``rule.json``: the settings; ``rule``, the numbers; ``words``, the rule in words;
        ``earned``, what the last generation's best earned per step by the goal; ``generations`` and
        ``seconds`` of CPU.

    Raises:
        UserError: no such rival, or a folder with other files or another search.
        KeyboardInterrupt: stopped by the user.
    """
    other, folder = other_side(config.side), Path(out)
    asked = list(SCRIPTS[other]) if config.against is None else config.against
    reward = None if config.reward == "own" else config.reward
    game = GameSpec.of(policy_env(config.side).id, against=asked, reward=reward, **config.game)
    scenario, names = game.resolve(), cast("list[str]", expand_suites(getattr(game, other), other))
    rivals = [as_player(name, other, scenario) for name in names]
    about: Row = {
        "side": config.side,
        "against": [policy_hash(player) or name for name, player in zip(names, rivals, strict=True)],
        "scenario": scenario.hash,
        "path": game.to_dict().get("path"),
        "goal": config.goal,
        "reward": config.reward,
        "seed": config.seed,
    }
    with search_folder(folder, f"{NAME}.json", f"{NAME}.jsonl", "rule search"):
        search = RuleSearch(config.side, rivals, scenario, config.goal, config.seed, config.reward)
        earned, seconds = run_search(search, folder, NAME, about, config.budget, progress)
        generations = search.generation
        best = search.simplify()
        numbers = rule_of(config.side, best)
        recipe: JsonObject = {"rule": numbers, "words": describe_rule(config.side, numbers)}
        model = rule_graph(config.side, scenario, rule_values(config.side, best[None], scenario)[0])
        write_found(folder / "agent", model, search, game, NAME, seconds, recipe)
        about |= {**recipe, "earned": earned, "generations": generations, "seconds": seconds}
        write_json(folder / f"{NAME}.json", about)
    return about


def rule_of(side: str, options: np.ndarray) -> dict[str, Option]:
    """Return the numbers of a rule from the indices of its options ``(numbers,)``."""
    chosen = zip(NUMBERS[side].items(), options.tolist(), strict=True)
    return {name: grid[k] for (name, grid), k in chosen}


class RuleSearch(CategoricalSearch):
    """Search over the numbers of the rules of a side.

    Args:
        side: side of the rule.
        rivals: players of the other side.
        scenario: what is played.
        goal: ``mean`` or ``lowest``.
        seed: training seed.
        reward: ``own``, or ``zero_sum`` to lower the rivals' returns.
        off: numbers that keep their first option.
    """

    def __init__(
        self,
        side: str,
        rivals: Sequence[Player],
        scenario: Scenario,
        goal: str = "mean",
        seed: int = 0,
        reward: str = "own",
        off: Collection[str] = (),
    ) -> None:
        model = rule_graph(side, scenario)

        def candidates(options: np.ndarray) -> Candidates:
            return Candidates(model, rule_values(side, options, scenario))

        play = earnings(candidates, side, rivals, scenario, reward)
        sizes = [1 if name in off else len(grid) for name, grid in NUMBERS[side].items()]
        super().__init__(sizes, play, len(rivals), seed, goal)
