"""Options of verbs that come from the fields of dataclasses."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from fpg_bench.cli.fields import Fields, Given, first_sentences, with_fields
from fpg_bench.cli.options import game_options
from fpg_bench.cli.training import train
from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Workers
from fpg_bench.game.spec import GameSpec, option_names
from fpg_bench.training.config import RunConfig


@dataclass(frozen=True)
class Tea:
    """Tea for a cup.

    Attributes:
        kind: sort of the ``leaves``, or several; None: green. In Python also an object.
        minutes: time in the pot, which
            decides the taste.
        file, label: of the cup.

    Raises:
        UserError: no water.
    """

    kind: str | None = None
    minutes: int = 3
    file: str | Path | None = None
    label: str = "mine"

    def __post_init__(self) -> None:
        if self.minutes > 60:
            raise UserError("minutes: the tea is cold")


def run(verb, *words):
    app = typer.Typer()
    app.command()(with_fields(verb))
    return CliRunner().invoke(app, list(words), env={"COLUMNS": "200"})


@dataclass(frozen=True)
class Cup:
    """A cup.

    Attributes:
        handles: where it is held.
    """

    handles: tuple[int, ...] = ()


def test_a_field_whose_type_no_option_has_is_an_error_where_the_verb_is_made():
    def drink(cup: Annotated[Cup, Fields(Cup)]) -> None: ...

    with pytest.raises(TypeError, match=r"Cup\.handles: no option has the type tuple\[int, \.\.\.\]"):
        with_fields(drink)
    drink.__annotations__["cup"] = Annotated[Given, Fields(Cup, ())]  # none of its fields
    assert not inspect.signature(with_fields(drink)).parameters


def test_the_first_sentence_of_a_field_is_its_help():
    assert first_sentences(Tea) == {
        "kind": "Sort of the leaves, or several. Default: green.",
        "minutes": "Time in the pot, which decides the taste.",
        "file": "Of the cup.",
        "label": "Of the cup.",
    }
    assert set(option_names()) <= set(first_sentences(GameSpec))


def test_a_run_s_own_fields_are_options_of_train():
    options, sentences = inspect.signature(with_fields(train)).parameters, first_sentences(RunConfig)
    assert {each.name for each in fields(RunConfig)} - set(options) == {"game", "dataset", "planner_options"}
    for name in ("steps", "hyperparams", "start", "suite", "allow"):
        option = options[name].annotation.__metadata__[0]
        assert option.help.startswith(sentences[name])


def test_a_verb_gets_the_dataclass_with_the_defaults_that_it_names():
    made = []

    def brew(tea: Annotated[Tea, Fields(Tea)] = Tea(minutes=5), cups: int = 1) -> None:
        made.append((tea, cups))

    assert run(brew, "--file", "cup.txt", "--cups", "2").exit_code == 0
    assert made == [(Tea(minutes=5, file=Path("cup.txt")), 2)]
    shown = run(brew, "--help").output
    assert "decides the taste. [default: 5]" in " ".join(shown.split())
    assert isinstance(run(brew, "--minutes", "61").exception, UserError)


def test_a_verb_may_take_some_fields_by_name_and_only_those_that_are_given():
    seen = []

    def brew(*, tea: Annotated[Given, Fields(Tea, ("kind", "file"), lists=("kind",))]) -> None:
        seen.append(tea)

    assert run(brew).exit_code == run(brew, "--kind", "black,green").exit_code == 0
    assert seen == [{}, {"kind": ["black", "green"]}]
    assert run(brew, "--minutes", "4").exit_code == 2


def test_every_option_of_a_game_is_one_of_the_verbs():
    def verb(*, game: Annotated[Given, game_options()]) -> None:
        assert GameSpec.of("FPG/AllyVsScripted-v0", **game).options() == {
            "path": ("line", "circle"),
            "history": 4,
        }

    assert run(verb, "--path", "line,circle", "--history", "4").exception is None


def test_workers_refuse_what_cannot_be():
    assert Workers.of(3) == Workers(3)
    assert Workers().is_alone
    assert not Workers(1, "ray").is_alone
    for options in ({"n_jobs": 0}, {"backend": "loki"}, {"address": "a:1"}):
        with pytest.raises(UserError, match=next(iter(options))):
            Workers(**options)
