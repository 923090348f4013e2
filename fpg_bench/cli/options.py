"""Options that several verbs share."""

from __future__ import annotations

import dataclasses
import json
import math
import textwrap
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from typing import Annotated, Any

import typer

from fpg_bench.cli.fields import Fields, Given, first_sentences
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL, NAMED, registered_ids
from fpg_bench.common.output import print_line
from fpg_bench.common.parallel import Workers
from fpg_bench.common.products import load, offered
from fpg_bench.common.strict_json import Json
from fpg_bench.game.spec import LISTS, GameSpec, kind_of, option_names
from fpg_bench.training.algorithms import ALGORITHMS, JOINT, OFFLINE
from fpg_bench.training.config import RunConfig


def complete_player(incomplete: str) -> list[str]:
    """Return the scripts and shipped agents with this prefix, groups of training seeds before their members.

    Folders are completed by the shell itself, where no name has the prefix.
    """
    from fpg_bench.players.agent import baselines_folder

    agents = baselines_folder() / "agents"
    groups = [path.relative_to(agents).as_posix() for path in agents.glob("*/*")]
    seeds = [f"{group}/{seed.name}" for group in groups for seed in (agents / group).glob("seed_*")]
    names = [*NAMED["ally"], *NAMED["opponent"], "oracle", "all-scripted"]
    begun = _beginning(incomplete, [*names, *groups, *seeds])
    return [name for name in begun if name.count("/") < 2] or begun


def complete_id(incomplete: str) -> list[str]:
    """Return the environment ids with this prefix."""
    return _beginning(incomplete, [DUEL, *registered_ids()])


def complete_suite(incomplete: str) -> list[str]:
    """Return the suites with this prefix."""
    return _beginning(incomplete, _shipped("suites"))


def complete_dataset(incomplete: str) -> list[str]:
    """Return the data sets with this prefix."""
    return _beginning(incomplete, _shipped("datasets"))


def complete_algorithm(incomplete: str) -> list[str]:
    """Return the algorithms with this prefix that learn by playing."""
    return _beginning(incomplete, (*ALGORITHMS, *JOINT))


def complete_offline(incomplete: str) -> list[str]:
    """Return the algorithms with this prefix that learn from data sets."""
    return _beginning(incomplete, OFFLINE)


def _shipped(folder: str) -> list[str]:
    """Return the names of the YAML files in a folder of the baselines."""
    from fpg_bench.players.agent import baselines_folder

    return [path.stem for path in (baselines_folder() / folder).glob("*.yml")]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})


# Panels of long lists of options, in the order in which they are shown.
GAME = "Game"
GAME_DETAILS = "Details of the game"
OTHER_GAMES = "Other games"
LANGUAGE_MODEL = "Language model"
TRAINING = "Training"
EVALUATION = "Evaluation"
OUTPUT = "Output"
PARALLEL = "Parallel processes"
TRUST = "Files of others"
DETAILS = (
    GAME_DETAILS,
    OTHER_GAMES,
    LANGUAGE_MODEL,
    PARALLEL,
    TRUST,
)  # not shown first where options are many
_FIRST = ("against", "scenario", "opponent", "ally", "path")  # of a game's options


def whole_number(text: str) -> int:
    """Parse a positive integer written as ``2000000``, ``2_000_000`` or ``2e6``.

    Raises:
        typer.BadParameter: not a positive integer, or above 10^15.
    """
    try:
        number = Decimal(str(text))
        if 0 < number <= 10**15 and number == int(number):  # in this order: 1e999999999 is a number, too
            return int(number)
    except InvalidOperation:
        pass
    raise typer.BadParameter(f"expected a whole number above 0, such as 2000000 or 2e6, got {text!r}")


def share(text: str) -> float:
    """Parse a percentage such as ``5%`` into a share; raises UserError for anything else."""
    try:
        return float(text.strip().removesuffix("%")) / 100
    except ValueError:
        raise UserError(f"expected a percentage such as 5%, got {text!r}") from None


def steps_option(help: str) -> Any:
    """Return the option ``--steps``, which accepts numbers such as ``2e6``."""
    return typer.Option(parser=whole_number, metavar="STEPS", help=help, rich_help_panel=TRAINING)


_PLAYER = (
    "a script, a shipped agent, an agent's folder, hf://owner/name or package.module:object "
    "(see fpg-bench players)"
)
PlayerOption = Annotated[str, typer.Option(help=f"The player: {_PLAYER}.", autocompletion=complete_player)]


def game_options(*names: str) -> Fields:
    """Return options of games, the fields of a specification, by name; no names: all but the id."""
    players = {"autocompletion": complete_player}
    details: dict[str, dict[str, Any]] = {"opponent": players, "ally": players, "history": {"min": 1}}
    for name in {*option_names()}.difference(names or _FIRST):  # all of them are many
        details[name] = {"rich_help_panel": GAME_DETAILS} | details.get(name, {})
    return Fields(GameSpec, names or option_names(), (*LISTS, "scenario"), GAME, details)


def other_game_options() -> Fields:
    """Return the options that games of products add to those of other games; none without these products."""
    kinds = tuple(map(kind_of, offered("game")))
    every: type[GameSpec] = dataclasses.dataclass(frozen=True)(type("Options", kinds or (GameSpec,), {}))
    return Fields(every, tuple(set(option_names(every)) - set(option_names())), panel=OTHER_GAMES)


def run_options(*names: str) -> Fields:
    """Return options of a training run, fields of :class:`RunConfig`, by name."""
    details: dict[str, Given] = {
        "steps": {"parser": whole_number, "metavar": "STEPS"},
        "suite": {"autocompletion": complete_suite, "rich_help_panel": EVALUATION},
        "allow": {"rich_help_panel": TRUST},
    }
    return Fields(RunConfig, names, panel=TRAINING, details=details)


_WORDS = first_sentences(RunConfig)
SuiteOption = Annotated[str, typer.Option(help="A suite's name or YAML file.", autocompletion=complete_suite)]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print a JSON list of mappings instead of the table.")
]
AllowOption = Annotated[
    list[str] | None,
    typer.Option(help=f"{_WORDS['allow']} May be repeated.", rich_help_panel=TRUST),
]
ReuseOption = Annotated[
    bool,
    typer.Option(
        "--reuse", help="Keep earlier records of players of code, too, and those against rivals of code."
    ),
]
WideOption = Annotated[bool, typer.Option("--wide", help="Print all columns, for a wide terminal.")]
_WORKERS = Fields(Workers, panel=PARALLEL, details={"n_jobs": {"min": 1}})
WorkersOption = Annotated[Workers, _WORKERS]
LocalWorkersOption = Annotated[Workers, dataclasses.replace(_WORKERS, names=("n_jobs",))]


def llm_options(verb: str) -> Fields:
    """Return the options of language models for a verb; none without the product that has them."""
    kind, name, none = "language_model", f"options of {verb}", Fields(GameSpec, ())
    added: Fields = load(kind, name) if name in offered(kind) else none
    return added


def print_json(rows: Iterable[Json]) -> None:
    """Print a list of mappings as JSON; non-finite numbers become null."""
    finite = [
        {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}
        for row in rows
    ]
    typer.echo(json.dumps(finite, indent=2))


def name_all(head: str, names: Iterable[str]) -> None:
    """Print a heading and a list of names, wrapped for a terminal of 80 columns."""
    text = ", ".join(names)
    if text:
        typer.echo(f"{head}:" if head else "", nl=bool(head))
        print_wrapped(f"    {text}")


def print_wrapped(text: str) -> None:
    """Print a text wrapped for a terminal of 80 columns, further lines indented; a long path stays whole."""
    print_line(
        textwrap.fill(text, 78, subsequent_indent="    ", break_on_hyphens=False, break_long_words=False)
    )
