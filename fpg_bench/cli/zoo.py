"""``fpg-bench zoo``: the agents that are shipped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from fpg_bench.evaluation.zoo import Member, Zoo, ZooView


def zoo() -> None:
    """List the shipped agents: algorithm, seed and steps, their score, and whether their files are whole."""
    from fpg_bench.evaluation.zoo import load_zoo

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
    from fpg_bench.evaluation.zoo_scores import read_zoo_lines

    field = load_field(view.fields[0])
    summaries = summarise(read_zoo_lines(shipped, view, field), field)
    return {(s.entry, seed): score for s in summaries for seed, score in s.seed_scores().items()}


def _line(member: Member, score: float | None) -> str:
    whole = "whole" if member.is_whole() else "CHANGED: not the file that agent.json describes"
    told = "-" if score is None else f"{score:.1f}"
    return f"{member.name:36} {member.about()['training_steps']:12,} {told:>7}  {whole}"
