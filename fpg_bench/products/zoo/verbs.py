"""The verb ``zoo``."""

from __future__ import annotations

from typing import Annotated

import typer

from fpg_bench.cli.options import JsonOption, name_all, print_json
from fpg_bench.common.output import number
from fpg_bench.common.rows import Row


def zoo(
    every: Annotated[bool, typer.Option("--all", help="Print one line per training seed.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the shipped agents with their training steps and scores, and check their files.

    Example: fpg-bench zoo
    """
    from fpg_bench.players.agent import agents_of, baselines_folder
    from fpg_bench.players.player import SIDES
    from fpg_bench.products.zoo.zoo import policy_digest, read_scores

    scores, agents = read_scores(baselines_folder()), baselines_folder() / "agents"
    if not scores:
        typer.echo("no agents are shipped; python scripts/train_zoo.py trains them")
        return
    rows = [row for of in scores for row in _rows(of, every)]
    if as_json:
        print_json(rows)
        return
    width, suite_name = max(len(row["agent"]) for row in rows), None
    typer.echo(f"{'agent':{width}} {'seeds':>5} {'steps':>9} {'score':>5} {'95 % interval':>13}")
    for row in rows:
        if row["suite"] != suite_name:
            suite_name = row["suite"]
            typer.echo(f"on {suite_name}")
        interval = "-" if "seeds" in row else ""
        if row["low"] is not None:
            interval = f"[{number(row['low'])}, {number(row['high'])}]"
        typer.echo(
            f"{row['agent']:{width}} {row.get('seeds', ''):5} {row['steps']:9,} {number(row['score']):>5} "
            f"{interval:>13}".rstrip()
        )
    policies = {f"{of['agent']}/{seed}": one["policy"] for of in scores for seed, one in of["seeds"].items()}
    damaged = [name for name, policy in policies.items() if policy_digest(agents / name) != policy]
    for name in damaged:
        typer.echo(f"CHANGED: {name}: not the policy that was scored")
    size = sum(file.stat().st_size for name in policies for file in (agents / name).glob("*"))
    whole = "all policies are whole" if not damaged else f"{len(damaged)} policies are changed"
    typer.echo(f"{len(policies)} agents, {size / 1e6:.1f} MB; {whole}")
    every_name = [name for side in SIDES for name in agents_of(side)]
    name_all("champions", (name for name in every_name if "champion" in name))
    name_all("rules", (name for name in every_name if "/rule/" in name))


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
