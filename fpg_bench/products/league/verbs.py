"""The verbs of leagues: ``selfplay``, ``best-response`` and ``double-oracle``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.cli.completion import complete_player
from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import (
    EVALUATION,
    GAME,
    TRAINING,
    AllowOption,
    HyperparamsOption,
    game_options,
    steps_option,
    whole_number,
)
from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_writable
from fpg_bench.common.output import print_line
from fpg_bench.common.rows import Row


def selfplay(
    algorithm: Annotated[str, typer.Argument(help="The algorithm, as for train.")],
    out: Annotated[Path, typer.Option(help="Folder of all generations.")],
    generations: Annotated[
        int, typer.Option(min=1, help="Number of generations of each side.", rich_help_panel=TRAINING)
    ] = 10,
    steps: Annotated[int, steps_option("Training budget of one generation of one side.")] = 500_000,
    pool: Annotated[
        int,
        typer.Option(
            min=1,
            help="Maximum number of past generations of the other side to train against.",
            rich_help_panel=TRAINING,
        ),
    ] = 5,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            help="Seed of the trainings and of the draws from past generations.",
            rich_help_panel=TRAINING,
        ),
    ] = 0,
    hyperparams: HyperparamsOption = None,
    n_evals: Annotated[
        int,
        typer.Option(
            min=0, help="Number of evaluations of a generation on its suite.", rich_help_panel=EVALUATION
        ),
    ] = 1,
    *,
    game: Annotated[Given, game_options("scenario", "path", "knowledge", "jamming_types")],
    allow: AllowOption = None,
) -> None:
    """Train both sides alternately against past generations of each other; run it again to resume.

    Example: fpg-bench selfplay ppo --generations 10 --out runs/selfplay
    """
    check_writable(out)
    from fpg_bench.products.league.selfplay import selfplay as play

    agents = play(
        algorithm,
        out,
        generations=generations,
        steps=steps,
        pool=pool,
        seed=seed,
        hyperparams=hyperparams,
        evaluations=n_evals,
        allow=allow or (),
        **game,
    )
    print_line(f"agents: {agents['ally']}, {agents['opponent']}")


def best_response(
    agent: Annotated[
        str,
        typer.Argument(
            help="A shipped agent, an agent's folder, a script, or package.module:object.",
            autocompletion=complete_player,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the best responses and best_responses.json.")],
    side: Annotated[
        str | None,
        typer.Option(
            help="The player's side: ally or opponent. Default: that of the agent.", rich_help_panel=GAME
        ),
    ] = None,
    steps: Annotated[
        str,
        typer.Option(
            help="Training budget of each best response; several are separated by commas.",
            rich_help_panel=TRAINING,
        ),
    ] = "500000",
    n_seeds: Annotated[
        int,
        typer.Option(
            min=1, help="Number of training seeds of each algorithm and budget.", rich_help_panel=TRAINING
        ),
    ] = 3,
    algorithm: Annotated[
        str,
        typer.Option(
            help="The algorithm, as for train; several are separated by commas.", rich_help_panel=TRAINING
        ),
    ] = "ppo",
    start: Annotated[
        str,
        typer.Option(
            help="Start of each training: nothing, strongest (imitate the strongest known rival first), or "
            "nothing,strongest for both.",
            rich_help_panel=TRAINING,
        ),
    ] = "nothing",
    hyperparams: HyperparamsOption = None,
    reward: Annotated[
        str | None,
        typer.Option(
            help="zero_sum: lower the player's return; own: raise the response's return. Default: zero_sum "
            "against an ally, own against an opponent.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    *,
    game: Annotated[Given, game_options("scenario", "path", "actions")],
    n_scripts: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of scripts with random constants to evaluate in addition to the scripts.",
            rich_help_panel=TRAINING,
        ),
    ] = 0,
    search: Annotated[
        str | None,
        typer.Option(
            help="tabular: search a table of few features instead. portfolio: scripts, tables, "
            "PPO and its pupils in turn. Both play what they find against all training seeds of the agent.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    budget: Annotated[float, typer.Option(help="CPU seconds of --search.", rich_help_panel=TRAINING)] = 200.0,
    full: Annotated[
        bool,
        typer.Option(
            help="Run the full search instead: SAC, PPO with stacked frames (continuous, discrete, and "
            "discrete from the strongest), two seeds each, and 100 scripts with random constants; about "
            "half an hour.",
            rich_help_panel=TRAINING,
        ),
    ] = False,
    allow: AllowOption = None,
) -> None:
    """Train best responses to a fixed player and report its return against each.

    Example: fpg-bench best-response runs/ppo_0/agent --steps 500000 --out runs/exploited
    """
    check_writable(out)
    from fpg_bench.products.league.best_responses import best_responses, full_search, response_label

    if search is not None:
        _search_response(search, agent, out, budget, side=side, reward=reward, allow=allow or (), **game)
        return
    asked = {"side": side, "reward": reward, "allow": allow or (), **game}
    if full:
        row = full_search(agent, out, **asked)
    else:
        row = best_responses(
            agent,
            out,
            steps=[whole_number(word) for word in steps.split(",")],
            n_seeds=n_seeds,
            algorithm=algorithm.split(","),
            start=start.split(","),
            hyperparams=hyperparams,
            search=n_scripts,
            **asked,
        )
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
    allowed = options.pop("allow")
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


def double_oracle(
    out: Annotated[Path, typer.Option(help="Folder of the stages, responses and the exported agent.")],
    side: Annotated[
        str, typer.Option(help="The side that learns: ally or opponent.", rich_help_panel=GAME)
    ] = "ally",
    mode: Annotated[
        str,
        typer.Option(
            help="one: the side learns against all responses to it. both: the populations of both sides "
            "grow, and each answers the other's equilibrium. selfplay: the side and a rival learn at once.",
            rich_help_panel=TRAINING,
        ),
    ] = "one",
    stages: Annotated[int, typer.Option(min=1, help="The most stages.", rich_help_panel=TRAINING)] = 3,
    steps: Annotated[int, steps_option("Training budget of a stage.")] = 1_000_000,
    response_steps: Annotated[
        int | None, steps_option("Training budget of a response. Default: that of a stage.")
    ] = None,
    algorithm: Annotated[
        str, typer.Option(help="The algorithm of the side, as for train.", rich_help_panel=TRAINING)
    ] = "ppo-stack8",
    response_algorithm: Annotated[
        str, typer.Option(help="The algorithm of the responses.", rich_help_panel=TRAINING)
    ] = "ppo-stack8",
    response_actions: Annotated[
        str, typer.Option(help="The action mode of the responses.", rich_help_panel=TRAINING)
    ] = "discrete",
    against: Annotated[
        str | None,
        typer.Option(
            help="Rivals of the first stage, separated by commas; tone*8 counts eight times. Default: all "
            "scripts of the other side.",
            rich_help_panel=TRAINING,
        ),
    ] = None,
    weight: Annotated[
        int,
        typer.Option(
            min=1,
            help="How often a response is listed among the rivals, in mode one; in mode selfplay the rival "
            "that learns.",
            rich_help_panel=TRAINING,
        ),
    ] = 8,
    patience: Annotated[
        int,
        typer.Option(min=1, help="Stop after as many stages without a higher low.", rich_help_panel=TRAINING),
    ] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the trainings.", rich_help_panel=TRAINING)] = 0,
    hyperparams: HyperparamsOption = None,
    response_hyperparams: HyperparamsOption = None,
    *,
    game: Annotated[Given, game_options("scenario", "path", "actions", "knowledge", "jamming_types")],
    allow: AllowOption = None,
) -> None:
    """Train a side against fresh responses to it, stage by stage; run it again to resume.

    Example: fpg-bench double-oracle --side ally --actions uniform-hop --stages 3 --out runs/robust
    """
    check_writable(out)
    from fpg_bench.products.league.double_oracle import double_oracle as search

    result = search(
        out,
        side=side,
        mode=mode,
        stages=stages,
        steps=steps,
        response_steps=response_steps,
        algorithm=algorithm,
        response_algorithm=response_algorithm,
        response_actions=response_actions,
        against=None if against is None else against.split(","),
        weight=weight,
        patience=patience,
        seed=seed,
        hyperparams=hyperparams,
        response_hyperparams=response_hyperparams,
        allow=allow or (),
        **game,
    )
    stage = result["stage"]
    print_line(
        f"{out / 'agent'}: stage {stage}, {result['confirmed'][str(stage)]:.2f} per step against a response "
        "trained afterwards"
    )
