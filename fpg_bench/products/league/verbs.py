"""The verbs of league training, one for each algorithm."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Annotated, Any

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
from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_writable
from fpg_bench.common.output import print_line
from fpg_bench.common.rows import Row
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
    search: Annotated[
        str | None,
        typer.Option(
            help="tabular: search a table of few features instead. portfolio: scripts, rules, tables, "
            "PPO, and PPO that first imitates the strongest of these, in turn. Both play what they find "
            "against all training seeds of the agent.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    budget: Annotated[float, typer.Option(help="CPU seconds of --search.", rich_help_panel=TRAINING)] = 200.0,
) -> None:
    """Train best responses to a fixed player and report its return against each.

    Example: fpg-bench best-response runs/ppo_0/agent --steps 500000 --out runs/exploited
    """
    check_writable(out)
    require_libraries()
    from fpg_bench.products.league.best_responses import best_responses, response_label

    if search is not None:
        asked = {name: options.get(name) for name in ("side", "reward", "actions", "allow")}
        _search_response(search, agent, out, budget, **asked, **game)
        return
    config = BestResponseConfig(agent=agent, game=game, **options)
    row = best_responses(config, out, progress=sys.stdout.isatty())
    for response in row["responses"]:
        print_line(
            f"{response_label(response)}: {response['return']:.2f} per step, {_jamming(response)}; "
            f"{response['seconds'] / 60:.1f} min"
        )
    scripts = row["scripts"]
    strongest = min(scripts, key=lambda name: scripts[name]["return"])
    met = scripts[strongest]
    print_line(f"strongest script, {strongest}: {met['return']:.2f} per step, {_jamming(met)}")
    print_line(f"{agent}: lowest {row['lowest']['return']:.2f} per step, against {row['lowest']['against']}")
    paid_for_loss = all(response["reward"] == "zero_sum" for response in row["responses"])
    if row["lowest"]["against"] == strongest and paid_for_loss:
        print_line(
            f"{strongest} is stronger than these responses: they are not best responses yet; raise --steps"
        )


def _search_response(search: str, agent: str, out: Path, budget: float, **options: Any) -> None:
    """Run a search of ``best-response --search``, and print what each training seed keeps."""
    one_of(search, "search", ("tabular", "portfolio"))
    if options.pop("actions", None) is not None:
        raise UserError("actions: --search decides the actions of its responses; omit it")
    allowed = options.pop("allow") or ()
    result: Any
    if search == "tabular":
        from fpg_bench.products.league.tabular import tabular_response

        result = tabular_response(agent, out, budget=budget, **options)
    else:
        from fpg_bench.products.league.portfolio import portfolio

        result = portfolio(agent, out, budget=budget, allow=allowed, **options)
    for name, of in result["returns"].items():
        by = f", against {of['response']} ({of['spent']:.0f} CPU s)" if "response" in of else ""
        print_line(f"{name}: {of['return']:.2f} [{of['low']:.2f}, {of['high']:.2f}] per step{by}")
    lowest = result["lowest"]
    print_line(
        f"lowest: {result['returns'][lowest]['return']:.2f} per step, {lowest}; {result['seconds']:.0f} CPU s"
    )


def _jamming(met: Row) -> str:
    return f"jamming success rate {100 * met['measures']['jamming_success_rate']:.0f} %"


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
