"""The verbs of self-play and best responses: both sides learn, or one learns against the other as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import PathOption, ScenarioOption, listed, say, steps_option, whole_number
from fpg_bench.common.rows import Row

HyperparamsOption = Annotated[Path | None, typer.Option(help="a YAML file of your own")]


def selfplay(
    algorithm: Annotated[str, typer.Argument(help="as for train")],
    out: Annotated[Path, typer.Option(help="a folder for all generations")],
    generations: Annotated[int, typer.Option(min=1, help="of each side")] = 10,
    steps: Annotated[int, steps_option("budget of a generation of a side")] = 500_000,
    pool: Annotated[
        int, typer.Option(min=1, help="most past generations of the other side to train against")
    ] = 5,
    seed: Annotated[int, typer.Option(min=0, help="decides who is drawn from the past, and the matches")] = 0,
    hyperparams: HyperparamsOption = None,
    evaluations: Annotated[int, typer.Option(min=0, help="a generation's scores on its suite; 0: none")] = 1,
    scenario: ScenarioOption = None,
    path: PathOption = None,
    knowledge: Annotated[str | None, typer.Option(help="expert, none or a YAML file")] = None,
    jamming_types: Annotated[str | None, typer.Option(help="allowed types, separated by commas")] = None,
) -> None:
    """Train both sides in turns against each other's past generations; run it again to go on.

    Example: fpg-bench selfplay ppo --generations 10 --out runs/selfplay
    """
    from fpg_bench.training.league import selfplay as play

    agents = play(
        algorithm,
        out,
        generations=generations,
        steps=steps,
        pool=pool,
        seed=seed,
        hyperparams=hyperparams,
        evaluations=evaluations,
        scenario=scenario,
        path=listed(path),
        knowledge=knowledge,
        jamming_types=listed(jamming_types),
    )
    say(f"agents: {agents['ally']}, {agents['opponent']}")


def best_responses(
    agent: Annotated[
        str, typer.Argument(help="a shipped agent, an agent folder, a script, or package.module:object")
    ],
    out: Annotated[Path, typer.Option(help="a folder for the best responses and best_responses.json")],
    steps: Annotated[
        str, typer.Option(help="budget of each best response; several, separated by commas")
    ] = "500000",
    seeds: Annotated[int, typer.Option(min=1, help="how many of each algorithm and budget")] = 3,
    algorithm: Annotated[
        str, typer.Option(help="what trains them, as for train; several, separated by commas")
    ] = "ppo",
    start: Annotated[
        str,
        typer.Option(help="nothing; strongest: first imitate who takes most; or both, separated by a comma"),
    ] = "nothing",
    hyperparams: HyperparamsOption = None,
    side: Annotated[str | None, typer.Option(help="ally or opponent; default: the agent's")] = None,
    scenario: ScenarioOption = None,
    path: PathOption = None,
    reward: Annotated[
        str, typer.Option(help="zero_sum: to lower the player's return; own: to raise the response's")
    ] = "zero_sum",
) -> None:
    """Train best responses against a player as it is, and say what it earns against them.

    Example: fpg-bench exploit runs/ppo_0/agent --steps 500000 --out runs/exploited
    """
    from fpg_bench.training.league import best_responses as respond
    from fpg_bench.training.league import response_label

    row = respond(
        agent,
        out,
        steps=[whole_number(word) for word in steps.split(",")],
        seeds=seeds,
        algorithm=algorithm.split(","),
        start=start.split(","),
        hyperparams=hyperparams,
        side=side,
        scenario=scenario,
        path=listed(path),
        reward=reward,
    )
    for response in row["responses"]:
        say(f"{response_label(response)}: {response['return']:.2f} a step, jammed {_percent(response)}")
    scripts = row["scripts"]
    strongest = min(scripts, key=lambda name: scripts[name]["return"])
    met = scripts[strongest]
    say(f"strongest script, {strongest}: {met['return']:.2f} a step, jammed {_percent(met)}")
    say(f"{agent}: lowest {row['lowest']['return']:.2f} a step, against {row['lowest']['against']}")
    if row["lowest"]["against"] == strongest:
        say(f"{strongest} takes more than these responses: they are no best ones yet; give more --steps")


def _percent(met: Row) -> str:
    return f"{100 * met['measures']['jamming_success_rate']:.0f} %"
