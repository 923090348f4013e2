"""The verbs of league training, one for each algorithm."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.fields import Fields, Given
from fpg_bench.cli.options import (
    EVALUATION,
    GAME,
    TRAINING,
    TRUST,
    complete_player,
    game_options,
    whole_number,
)
from fpg_bench.common.files import check_writable
from fpg_bench.common.output import print_line
from fpg_bench.products.league import config as league
from fpg_bench.products.league.config import (
    BestResponseConfig,
    DoubleOracleConfig,
    RuleSearchConfig,
    TabularSelfPlayConfig,
)
from fpg_bench.training import require_libraries

OutOption = Annotated[Path, typer.Option(help="Folder of all runs, results and exported agents.")]
GameOptions = Annotated[Given, game_options(*league.GAME)]


def league_options(kind: type[league.LeagueConfig | RuleSearchConfig]) -> Fields:
    """Return the options of an algorithm, the fields of its configuration but ``agent`` and ``game``."""
    names = [each.name for each in dataclasses.fields(kind) if each.name not in ("agent", "game")]
    details: dict[str, Given] = {
        name: {"min": least} for name, least in league.LEAST.items() if not name.endswith("steps")
    }
    details |= {name: {"parser": whole_number, "metavar": "STEPS"} for name in ("steps", "response_steps")}
    details |= {"side": {"rich_help_panel": GAME}, "allow": {"rich_help_panel": TRUST}}
    details["n_evals"] = {"min": 0, "rich_help_panel": EVALUATION}
    return Fields(kind, tuple(names), ("against",), TRAINING, details)


def best_response(
    agent: Annotated[
        str,
        typer.Argument(
            help="A shipped agent, an agent's folder, a script, or package.module:object.",
            autocompletion=complete_player,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the best responses and best_responses.json.")],
    options: Annotated[Given, league_options(BestResponseConfig)],
    game: GameOptions,
) -> None:
    """Search best responses to a fixed player, and report what it keeps against the strongest.

    They are trained, unless --search names another way. Each training seed of the player is played.

    Example: fpg-bench best-response runs/ppo_0/agent --steps 500000 --out runs/exploited
    """
    check_writable(out)
    require_libraries()
    from fpg_bench.products.league.best_responses import best_responses

    config = BestResponseConfig(agent=agent, game=game, **options)
    result = best_responses(config, out, progress=sys.stdout.isatty())
    for name, of in result["returns"].items():
        kept = f"{of['return']:.2f} [{of['low']:.2f}, {of['high']:.2f}] per step"
        print_line(f"{name}: {kept}, against {of['response']} ({of['spent']:.0f} CPU s)")
    lowest = result["returns"][result["lowest"]]
    print_line(f"lowest: {lowest['return']:.2f} per step, {result['lowest']}; {result['seconds']:.0f} CPU s")
    if lowest["method"] == "script":
        print_line(
            f"{lowest['response']} is stronger than these responses: they are not best responses yet; raise "
            "--steps or --budget"
        )


def rule_search(
    out: OutOption, options: Annotated[Given, league_options(RuleSearchConfig)], game: GameOptions
) -> None:
    """Search a short rule, a few numbers that can be read in a line, against a pool of rivals.

    Example: fpg-bench rule-search --side ally --against suite:training-1 --out runs/rule
    """
    check_writable(out)
    require_libraries()
    from fpg_bench.products.league.rule_search import rule_search as search

    result = search(RuleSearchConfig(game=game, **options), out)
    print_line(f"{out / 'agent'}: {result['words']}")
    print_line(f"{result['goal']} return {result['earned']:.2f} per step; {result['seconds']:.0f} CPU s")


def tabular_self_play(
    out: OutOption, config: Annotated[TabularSelfPlayConfig, Fields(TabularSelfPlayConfig, panel=TRAINING)]
) -> None:
    """Train an ally and opponents against each other at once, all of them stochastic tables.

    Example: fpg-bench tabular-self-play --out runs/tables
    """
    check_writable(out)
    require_libraries()
    from fpg_bench.products.league.tabular_self_play import tabular_self_play as play

    print_line(f"agent: {play(config, out)}")


def double_oracle(
    out: OutOption, options: Annotated[Given, league_options(DoubleOracleConfig)], game: GameOptions
) -> None:
    """Train a side against responses to it, iteration by iteration; run it again to resume.

    Example: fpg-bench double-oracle --actions uniform-hop --iterations 3 --out runs/robust
    """
    check_writable(out)
    require_libraries()
    from fpg_bench.products.league.double_oracle import double_oracle as search

    result = search(DoubleOracleConfig(game=game, **options), out)
    iteration = result["iteration"]
    print_line(
        f"{out / 'agent'}: iteration {iteration}, {result['confirmed'][str(iteration)]:.2f} per step against "
        "a response trained afterwards"
    )
