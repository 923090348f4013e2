"""``fpg-bench plan compare``: planners side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import (
    CallsOption,
    DeadlineOption,
    PromptOption,
    SamplingSeedOption,
    SecondsOption,
    ServerOption,
    TemperatureOption,
    TokensOption,
    WideOption,
    llm_options,
)


def compare(
    planners: Annotated[
        list[str] | None,
        typer.Argument(
            help="planners, package.module:object, llm, llm-shuffled-rewards, llm-no-history; "
            "all (as if none is named): those that ask no language model"
        ),
    ] = None,
    field: Annotated[str, typer.Option(help="a field's name or YAML file")] = "planner-v1",
    out: Annotated[Path, typer.Option(help="the results folder")] = Path("comparison"),
    matches: Annotated[int | None, typer.Option(help="matches per ally; default: the field's")] = None,
    transcripts: Annotated[
        Path | None, typer.Option(help="a folder of language models' transcripts: one more planner each")
    ] = None,
    prompt: PromptOption = None,
    server: ServerOption = None,
    temperature: TemperatureOption = None,
    sampling_seed: SamplingSeedOption = None,
    calls: CallsOption = None,
    tokens: TokensOption = None,
    seconds: SecondsOption = None,
    deadline: DeadlineOption = None,
    wide: WideOption = False,
    concurrency: Annotated[int | None, typer.Option(min=1, help="llm: calls under way at once")] = None,
) -> None:
    """Compare planners by a field of allies; what is in the folder already is not played again.

    Example: fpg-bench plan compare circle hill-climb interceptor --matches 10 --out results/planners
    """
    from fpg_bench.cli.verbs import shown_progress, table
    from fpg_bench.evaluation.compare import compare as compare_planners

    caps = {"calls": calls, "tokens": tokens, "seconds": seconds, "concurrency": concurrency}
    sampled = {"temperature": temperature, "sampling_seed": sampling_seed}
    llm = llm_options(deadline, prompt=prompt, server=server, **sampled, **caps)
    with shown_progress() as show:
        compare_planners(
            planners or ["all"],
            field,
            out,
            matches=matches,
            transcripts=transcripts,
            llm=llm,
            progress=lambda entry, ally, rounds: show(f"{entry.name} - {ally.name}, {rounds} rounds played"),
        )
    table(out, wide)
