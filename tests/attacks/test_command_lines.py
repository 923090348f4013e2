"""Wrong command lines: each ends with one clear line and a status, and none with a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from fpg_bench import cli

HOSTILE = (
    "no/such\x1b[31mthing",
    "\N{RIGHT-TO-LEFT OVERRIDE}gnp.exe",
    "../../etc/passwd",
    "a" * 5000,
    "'; --",
)


COMMAND: Any = typer.main.get_command(cli.app)  # building it for each line would take a tenth of a second


def verbs(group: Any = COMMAND, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """All commands with their words."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from verbs(command, (*words, name))
        else:
            yield (*words, name), command


def spoiled(words: tuple[str, ...], command: Any) -> Iterator[tuple[str, ...]]:
    """Command lines of a verb that are wrong in one way each."""
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    options = [each for each in command.params if each.param_type_name == "option"]
    given = [word for each in arguments if each.required for word in ("something",)]
    given += [word for each in options if each.required for word in (each.opts[0], "somewhere")]
    yield (*words, *given, "--no-such-option", "1")
    if given:
        yield words
    if not any(each.nargs == -1 for each in arguments):
        yield (*words, *given, *["surplus"] * (len(arguments) + 1))
    for option in options:
        if option.is_flag:
            yield (*words, *given, f"{option.opts[0]}=maybe")
            continue
        if isinstance(option.default, int | float) or option.bare_type in (int, float):
            yield (*words, *given, option.opts[0], "many")
        else:
            yield (*words, *given, option.opts[0])


VERBS = [list(spoiled(words, command)) for words, command in verbs()]
VERBS += [[(*words, value) for value in HOSTILE] for words in ((), ("train",), ("evaluate",), ("table",))]


@pytest.mark.parametrize("lines", VERBS, ids=lambda lines: ascii(" ".join(lines[0][:2])[:40]))
def test_a_wrong_command_line_is_one_line(lines, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "app", COMMAND)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    for line in lines:
        monkeypatch.setattr(sys, "argv", ["fpg-bench", *line])
        with pytest.raises(SystemExit) as end:
            cli.main()
        error = capsys.readouterr().err
        assert end.value.code in (1, 2), line
        assert error.startswith("fpg-bench: "), line
        assert error.count("\n") == 1, line
        assert "a bug" not in error, line
        assert error[:-1].isprintable(), line
        assert not list(tmp_path.iterdir()), line
