"""The verbs that list names: ``envs``, ``zoo``, ``players`` and ``suites``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import typer

from fpg_bench.cli.completion import complete_id, complete_suite
from fpg_bench.cli.fields import Given
from fpg_bench.cli.options import JsonOption, game_options, name_all, print_json, print_wrapped
from fpg_bench.common.documentation import page
from fpg_bench.common.errors import UserError
from fpg_bench.common.output import number
from fpg_bench.common.products import offered
from fpg_bench.common.rows import Row

if TYPE_CHECKING:
    from fpg_bench.common.ids import EnvConfig
    from fpg_bench.evaluation.suite import Suite
    from fpg_bench.evaluation.zoo import ZooAgent

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


def zoo(
    every: Annotated[bool, typer.Option("--all", help="Print one line per training seed.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the shipped agents with their training steps and scores, and check their files.

    Example: fpg-bench zoo
    """
    from fpg_bench.evaluation.zoo import policy_digest, read_scores
    from fpg_bench.players.agent import baselines_folder
    from fpg_bench.players.player import SIDES

    scores, agents = read_scores(baselines_folder()), baselines_folder() / "agents"
    if not scores:
        typer.echo("no agents are shipped; python scripts/train_zoo.py trains them")
        return
    rows = [row for of in scores for row in _rows(of, every)]
    if as_json:
        print_json(rows)
        return
    width, suite_name = max(len(row["agent"]) for row in rows), None
    typer.echo(f"{'agent':{width}} {'seeds':>5} {'steps':>9} {'score':>6} {'95 % interval':>13}")
    for row in rows:
        if row["suite"] != suite_name:
            suite_name = row["suite"]
            typer.echo(f"on {suite_name}")
        interval = "-" if "seeds" in row else ""
        if row["low"] is not None:
            interval = f"[{number(row['low'])}, {number(row['high'])}]"
        typer.echo(
            f"{row['agent']:{width}} {row.get('seeds', ''):5} {row['steps']:9,} {number(row['score']):>6} "
            f"{interval:>13}".rstrip()
        )
    policies = {f"{of['agent']}/{seed}": one["policy"] for of in scores for seed, one in of["seeds"].items()}
    damaged = [name for name, policy in policies.items() if policy_digest(agents / name) != policy]
    for name in damaged:
        typer.echo(f"CHANGED: {name}: not the policy that was scored")
    size = sum(file.stat().st_size for name in policies for file in (agents / name).glob("*"))
    whole = "all policies are whole" if not damaged else f"{len(damaged)} policies are changed"
    typer.echo(f"{len(policies)} agents, {size / 1e6:.1f} MB; {whole}")
    name_all("champions", (name for side in SIDES for name in _champions(side)))


def _rows(of: Row, every: bool) -> list[Row]:
    """Return one row for all training seeds of an algorithm, or one per seed if ``every``."""
    suite = {"suite": of["suite"]}
    if not every:
        return [{**of, "seeds": len(of["seeds"]), **suite}]
    unknown = {"low": None, "high": None, **suite}
    return [
        {"agent": f"{of['agent']}/{seed}", "steps": one["steps"], "score": one["score"], **unknown}
        for seed, one in of["seeds"].items()
    ]


def players() -> None:
    """List the names of players, planners and flight paths.

    Example: fpg-bench players
    """
    from fpg_bench.evaluation.zoo import load_zoo
    from fpg_bench.game.names import PATHS
    from fpg_bench.players.player import SIDES

    members = [member for member in load_zoo().members() if member.shipped]
    for side in SIDES:
        for group, names in _grouped(side, "group").items():
            if group != "oracle":
                name_all(f"{group}, {side}", names)
        name_all(f"agents, {side}", _agents(member for member in members if member.group.side == side))
        name_all(f"champions, {side}", _champions(side))
        name_all(f"populations, {side}", _populations(side))
    name_all("either side", ["oracle: sees the full state, so it is in no suite"])
    for tier, names in _grouped("planner", "tier").items():
        name_all(f"planners, tier {tier}", names)
    name_all("paths", PATHS)
    print_wrapped("Your own: an agent's folder, or package.module:object. All agents' scores: fpg-bench zoo")
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


def _champions(side: str) -> list[str]:
    """Return the names of the shipped champions of a side, which no group of the zoo holds."""
    from fpg_bench.players.agent import baselines_folder

    agents = baselines_folder() / "agents"
    folders = sorted(agents.glob(f"{side}-*champion*/*/seed_*"))
    return [folder.relative_to(agents).as_posix() for folder in folders]


def _agents(members: Iterable[ZooAgent]) -> list[str]:
    """Return the agents' names, with training seeds grouped."""
    seeds: dict[str, list[str]] = {}
    for member in members:
        seeds.setdefault(f"{member.group.name}/{member.algorithm}", []).append(str(member.seed))
    return [
        f"{name}/seed_{{{','.join(of)}}}" if len(of) > 1 else f"{name}/seed_{of[0]}"
        for name, of in seeds.items()
    ]


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
