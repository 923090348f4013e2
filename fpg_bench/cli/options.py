"""Options that several verbs share."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from typing import Annotated, Any

import typer

from fpg_bench.common.errors import printable


def whole_number(text: str) -> int:
    """The number above 0 of ``2000000``, ``2_000_000`` or ``2e6``.

    Raises:
        typer.BadParameter: it is none, or above 10^15.
    """
    try:
        number = Decimal(str(text))
        if 0 < number <= 10**15 and number == int(number):  # in this order: 1e999999999 is a number, too
            return int(number)
    except InvalidOperation:
        pass
    raise typer.BadParameter(f"expected a whole number above 0, 2000000 or 2e6 for instance, got {text!r}")


def steps_option(help: str) -> Any:
    """``--steps``, also as ``2e6``."""
    return typer.Option(parser=whole_number, metavar="STEPS", help=help)


_PLAYER = "a script, a shipped agent, an agent's folder or package.module:object (fpg-bench players)"
PlayerOption = Annotated[str, typer.Option(help=_PLAYER)]
PlayersOption = Annotated[
    str | None, typer.Option(help=f"against whom: {_PLAYER}, or suite:NAME; several, separated by commas")
]
ScenarioOption = Annotated[str | None, typer.Option(help="standard, paper, figures or a YAML file")]
PathOption = Annotated[str | None, typer.Option(help="how the opponent flies; several, separated by commas")]
PlannerOption = Annotated[str | None, typer.Option(help="who plans the opponent's path between rounds")]

WideOption = Annotated[bool, typer.Option("--wide", help="all columns, for a wide terminal")]
JobsOption = Annotated[int, typer.Option(min=1, help="how many at once, one core each")]
BackendOption = Annotated[str, typer.Option(help="where: loky, processes of this machine, or ray, a cluster")]
AddressOption = Annotated[
    str | None, typer.Option(help="ray: host:port of the cluster; default: RAY_ADDRESS, else this machine")
]

# Of the planner llm; the defaults are those of LLMPlanner.
PromptOption = Annotated[
    str | None, typer.Option(help="llm: brief, paper, standard or a YAML file; default: the server's")
]
ServerOption = Annotated[str | None, typer.Option(help="llm: the server's profile or YAML file")]
CallsOption = Annotated[int | None, typer.Option(min=1, help="llm: most calls of the run; default: 20000")]
TokensOption = Annotated[
    int | None, typer.Option(min=1, help="llm: most tokens, read and written; default: 200 million")
]
SecondsOption = Annotated[
    float | None, typer.Option(min=0, help="llm: most seconds in calls; default: a week")
]
DeadlineOption = Annotated[
    float | None, typer.Option(min=0, help="llm: seconds that a call may take; default: 30, or as measured")
]
TemperatureOption = Annotated[
    float | None, typer.Option(min=0, max=2, help="llm: what the server is sent; default: its profile's")
]
SamplingSeedOption = Annotated[
    int | None, typer.Option(min=0, help="llm: decides the seeds that the server is sent; default: 0")
]


def llm_options(deadline: float | None, **options: Any) -> dict[str, Any]:
    """Those of the planner llm that were said, by the names of LLMPlanner."""
    return {name: value for name, value in (options | {"deadline_s": deadline}).items() if value is not None}


def listed(value: str | None) -> Any:
    """One word, or a list of several that are separated by commas."""
    return value.split(",") if value is not None and "," in value else value


def say(line: str) -> None:
    """Print a line at once, also into a file; what it quotes of others does nothing to a terminal."""
    print(printable(line), flush=True)


def name_all(head: str, names: Iterable[str]) -> None:
    """Print a heading and names, as wide as a narrow terminal."""
    text = ", ".join(names)
    if text:
        typer.echo(f"{head}:" if head else "", nl=bool(head))
        typer.echo(
            textwrap.fill(text, 78, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
        )
