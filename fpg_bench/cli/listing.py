"""The verbs that list names: ``envs``, ``players`` and ``suites``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import complete_id, complete_suite, game_options, name_all, print_wrapped
from fpg_bench.common.errors import UserError
from fpg_bench.common.output import page
from fpg_bench.common.products import offered

if TYPE_CHECKING:
    from fpg_bench.common.ids import EnvConfig
    from fpg_bench.evaluation.suite import Suite

_BOTH_SIDES = "Both sides at once: fpg_bench.make_duel(n), and FPG/duel_v0 in PettingZoo's registry."


def envs(
    env_id: Annotated[
        str | None,
        typer.Argument(
            metavar="[ID]",
            help="A single id; with discrete actions, its choices are listed. Default: list all ids.",
            autocompletion=complete_id,
        ),
    ] = None,
    *,
    game: Annotated[Given, game_options("path", "scenario")],
) -> None:
    """List the environment ids with their defaults, observations and actions, or print a single id.

    Example: fpg-bench envs FPG/OpponentVsScriptedDiscrete-v0
    """
    from fpg_bench.common.ids import find_env, id_with, sides_of

    is_duel = env_id is not None and len(sides_of(env_id)) > 1
    config = None if env_id is None or is_duel else find_env(env_id)
    if config is not None and config.actions != "continuous":
        _print_choices(config, game)
    elif game:
        raise UserError("--path and --scenario change the choices of an id with discrete actions alone")
    elif config is not None:
        _print_env(config)
        typer.echo(f"    actions: nine floats; as a list of choices: {id_with(config.id, 'discrete')}")
    elif is_duel:
        print_wrapped(_BOTH_SIDES)
    else:
        _print_all_envs()


def _print_all_envs() -> None:
    """Print all ids, and what the sides observe and choose."""
    from fpg_bench.common.ids import ENVS
    from fpg_bench.game.names import CHOSEN, OBSERVED
    from fpg_bench.players.player import SIDES

    for config in ENVS.values():
        _print_env(config)
    print_wrapped(_BOTH_SIDES)
    print_wrapped(f"A round: 300 steps of 1 s. All numbers lie in [-1, 1]; scales: {page('reference/rules')}")
    for side in SIDES:
        name_all(f"{side} sees", (f"{k} {name}" for k, name in enumerate(OBSERVED[side])))
        name_all(f"{side} chooses", (f"{k} {name}" for k, name in enumerate(CHOSEN[side])))
    print_wrapped(
        "Choices from a list: actions='discrete' or 'multi-discrete', or an id such as "
        "FPG/AllyVsScriptedDiscrete-v0; fpg-bench envs ID lists them."
    )
    print_wrapped("The ally's spectrum in place of the numbers: observation='waterfall'.")


def _print_env(config: EnvConfig) -> None:
    """Print an id with its defaults."""
    flown = f"planned by {config.planner}" if config.planner else config.path
    typer.echo(config.id)
    print_wrapped(f"    {config.about}")
    print_wrapped(
        f"    you play: {config.side}; {config.other_side}: {config.other}; opponent's path: {flown}; "
        f"rounds a match: {config.rounds_per_match}"
    )


def _print_choices(config: EnvConfig, game: Given) -> None:
    """Print each choice of an id with discrete actions, with its name and its nine floats."""
    from fpg_bench.game.choices import Choices
    from fpg_bench.game.scenario import as_scenario

    played = as_scenario(game.get("scenario"), opponent_path=game.get("path", config.path))
    for of in Choices(config.side, config.actions, played).lists:
        typer.echo(f"{of.name}: {len(of)}")
        width = max(map(len, of.names))
        for index, (name, row) in enumerate(zip(of.names, of.rows.tolist(), strict=True)):
            typer.echo(f"{index:5}  {name:{width}}  {' '.join(f'{value:5.2f}' for value in row)}")


def players() -> None:
    """List the names of players, planners and flight paths.

    Example: fpg-bench players
    """
    from fpg_bench.game.names import PATHS
    from fpg_bench.players.agent import agents_of
    from fpg_bench.players.player import SIDES

    for side in SIDES:
        for group, names in _grouped(side, "group").items():
            if group != "oracle":
                name_all(f"{group}, {side}", names)
        name_all(f"agents, {side}", agents_of(side))
        name_all(f"populations, {side}", _populations(side))
    name_all("either side", ["oracle: sees the full state, so it is in no suite"])
    for tier, names in _grouped("planner", "tier").items():
        name_all(f"planners, tier {tier}", names)
    name_all("paths", PATHS)
    scores = " All agents' scores: fpg-bench zoo" if "zoo" in offered("verb") else ""
    print_wrapped(f"Your own: an agent's folder, or package.module:object.{scores}")
    if "hf://" in offered("agent"):
        typer.echo("On the Hugging Face Hub: hf://owner/name, or hf://owner/name@revision")


def suites(
    name: Annotated[
        str | None,
        typer.Argument(help="A suite to describe. Default: list all suites.", autocompletion=complete_suite),
    ] = None,
) -> None:
    """List the suites with their rivals, or describe one of them.

    Example: fpg-bench suites ally-v2
    """
    from fpg_bench.evaluation.suite import read_suite, suite_names

    names = suite_names() if name is None else [name]
    for suite in map(read_suite, names):
        typer.echo(f"{suite.name}: {_described(suite)}")
        name_all("", [rival.name for rival in suite.rivals])
    if name is None:
        print_wrapped(f"Your own: a YAML file of the same form, see {page('benchmark/protocol')}")


def _described(suite: Suite) -> str:
    rounds = f" of {suite.rounds_per_match} rounds" if suite.rounds_per_match > 1 else ""
    met = f"{suite.matches} matches{rounds} per rival"
    return f"measures the {suite.side}, {met}\n    {suite.scale.description}"


def _populations(side: str) -> list[str]:
    """Return the suites whose agents ``suite:NAME`` draws from."""
    from fpg_bench.players.agent import suites_folder

    folders = {path.parents[2].name for path in suites_folder().glob(f"*/{side}/*/agent.json")}
    return [f"suite:{name}" for name in sorted(folders)]


def _grouped(kind: str, key: str) -> dict[str, list[str]]:
    """Return the names of what is offered of a kind, by an attribute of the offers."""
    groups: dict[str, list[str]] = {}
    for name, offer in offered(kind).items():
        groups.setdefault(getattr(offer, key), []).append(name)
    return groups
