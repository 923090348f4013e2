"""What there is to name: ``fpg-bench envs``, ``zoo`` (the shipped agents), ``players`` and ``fields``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

from fpg_bench.cli.options import name_all
from fpg_bench.extras import need

if TYPE_CHECKING:
    from fpg_bench.evaluation.field import Field
    from fpg_bench.zoo.zoo import Zoo, ZooAgent, ZooView


def envs() -> None:
    """List the environment ids, what they default to, and what each side sees and chooses.

    Example: fpg-bench envs
    """
    from fpg_bench.game.names import CHOSEN, OBSERVED
    from fpg_bench.ids import VIEWS
    from fpg_bench.players.player import SIDES

    for view in VIEWS.values():
        flown = f"planned by {view.planner}" if view.planner else view.path
        typer.echo(f"{view.id}\n    {view.about}")
        typer.echo(
            f"    you play: {view.side}; {view.other_side}: {view.other}; opponent's path: {flown}; "
            f"rounds a match: {view.rounds_per_match}"
        )
    typer.echo("Both sides at once: fpg_bench.make_duel(n), and FPG/duel_v0 in PettingZoo's registry.")
    typer.echo("A round: 300 steps of 1 s. All numbers lie in [-1, 1]; docs/rules.md has their scales.")
    for side in SIDES:
        name_all(f"{side} sees", (f"{k} {name}" for k, name in enumerate(OBSERVED[side])))
        name_all(f"{side} chooses", (f"{k} {name}" for k, name in enumerate(CHOSEN[side])))


def zoo() -> None:
    """List the shipped agents: algorithm, seed and steps, their score, and whether their files are whole.

    Example: fpg-bench zoo
    """
    need("evaluate", "scipy")
    from fpg_bench.zoo.zoo import load_zoo

    shipped = load_zoo()
    members = [member for member in shipped.members() if member.shipped]
    if not members:
        typer.echo("no agents are shipped; python scripts/train_zoo.py trains them")
        return
    typer.echo(f"{'agent':36} {'steps':>12} {'score':>7}  policy")
    for view in shipped.views:
        scores = _scores(shipped, view)
        for member in members:
            if member.view == view:
                typer.echo(_line(member, scores.get((member.algorithm, member.seed))))
    size = sum(file.stat().st_size for member in members for file in member.folder.iterdir())
    typer.echo(f"{len(members)} agents, {size / 1e6:.1f} MB; scores over the first field of its view")


def _scores(shipped: Zoo, view: ZooView) -> dict[tuple[str, int | None], float]:
    """The score of each agent of a view over its public field, by algorithm and seed."""
    from fpg_bench.evaluation.field import load_field
    from fpg_bench.evaluation.summary import summarise

    field = load_field(view.fields[0])
    summaries = summarise(shipped.read_lines(view, field), field)
    return {(s.entry, seed): score for s in summaries for seed, score in s.seed_scores().items()}


def _line(member: ZooAgent, score: float | None) -> str:
    whole = "whole" if member.is_whole() else "CHANGED: not the file that agent.json describes"
    told = "-" if score is None else f"{score:.1f}"
    return f"{member.name:36} {member.about()['training_steps']:12,} {told:>7}  {whole}"


def players() -> None:
    """List who can be named as a player or planner, and the paths that an opponent flies.

    Example: fpg-bench players
    """
    from fpg_bench.game.names import PATHS
    from fpg_bench.players.player import SIDES
    from fpg_bench.players.scripted import SCRIPTED
    from fpg_bench.zoo.zoo import load_zoo

    members = [member for member in load_zoo().members() if member.shipped]
    for side in SIDES:
        name_all(f"scripts, {side}", SCRIPTED[side])
        name_all(f"agents, {side}", _agents(member for member in members if member.view.side == side))
        name_all(f"populations, {side}", _populations(side))
    name_all("either side", ["oracle: sees the full state, so it stands in no field"])
    for tier, names in _planners().items():
        name_all(f"planners, tier {tier}", names)
    name_all("paths", PATHS)
    typer.echo("Your own: an agent's folder, or package.module:object. All agents' scores: fpg-bench zoo")


def fields() -> None:
    """List the fields: who is measured against whom.

    Example: fpg-bench fields
    """
    from fpg_bench.evaluation.field import load_field
    from fpg_bench.players.agent import fields_folder

    for path in sorted(fields_folder().glob("*.yml")):
        field = load_field(path.stem)
        typer.echo(f"{field.name}: {_described(field)}")
        name_all("", [counterpart.name for counterpart in field.counterparts])
    typer.echo("Your own: a YAML file of the same form, see docs/measures.md")


def _described(field: Field) -> str:
    rounds = f" of {field.rounds_per_match} rounds" if field.rounds_per_match > 1 else ""
    met = f"{field.matches} matches{rounds} per counterpart"
    return f"measures the {field.side}, {met}\n    {field.scale.told}"


def _agents(members: Iterable[ZooAgent]) -> list[str]:
    """The agents' names, training seeds together."""
    seeds: dict[str, list[str]] = {}
    for member in members:
        seeds.setdefault(f"{member.view.name}/{member.algorithm}", []).append(str(member.seed))
    return [
        f"{name}/seed_{{{','.join(of)}}}" if len(of) > 1 else f"{name}/seed_{of[0]}"
        for name, of in seeds.items()
    ]


def _populations(side: str) -> list[str]:
    """The fields whose agents ``field:NAME`` draws from."""
    from fpg_bench.players.agent import fields_folder

    folders = {path.parents[2].name for path in fields_folder().glob(f"*/{side}/*/agent.json")}
    return [f"field:{name}" for name in sorted(folders)]


def _planners() -> dict[str, list[str]]:
    """The planners by what they know."""
    from fpg_bench.game.scenario import STANDARD
    from fpg_bench.planning import LLM_CONTROLS, PLANNERS, TIERS, as_planner
    from fpg_bench.planning.llm.llm_planner import LLMPlanner

    found: dict[str, list[str]] = {tier: [] for tier in TIERS}
    for name in PLANNERS:
        tier = LLMPlanner.tier if name in LLM_CONTROLS else as_planner(name, STANDARD).tier
        found[tier].append(name)
    return found
