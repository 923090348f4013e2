"""Wrong command lines: each ends with one clear line and a status, and none with a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any, get_args

import pytest
import typer

from fpg_bench.cli import main as cli

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


# A line of each verb that would do its work, small where it is not refused.
WORKING = (
    "play --steps 1",
    "train ppo FPG/AllyVsScripted-v0 --out out --steps 1 --n-evals 0",
    "train ppo FPG/team_v0 --side ally --out out --steps 1 --n-evals 0",
    "offline bc ally-random-v0 --out out --steps 1 --n-evals 0",
    "evaluate idle --suite ally-v2 --out out --matches 1",
    "best-response expert --steps 1 --n-seeds 1 --out out",
    "double-oracle --iterations 1 --steps 1 --out out",
    "rule-search --side opponent --against idle --budget 0.01 --out out",
    "tabular-self-play --iterations 1 --games 1 --out out",
    "export nowhere.zip --out out --algo ppo --id FPG/AllyVsScripted-v0 --scenario standard --seed 0",
    "reproduce yang-2026 fig3 --out out",
    "envs FPG/AllyVsScripted-v0",
    "suites ally-v2",
    "scenario show standard",
    "tune run ppo FPG/AllyVsScripted-v0 --n-trials 1 --n-seeds 1 --rounds 1 --steps 1 --out out",
    "tune export nowhere best.yml",
    "play --planner hill-climb --rounds 2",
    "evaluate circle --suite planner-v1 --prompt paper",
    "dataset make ally-random-v0",
    "dataset check nowhere",
    "hub push nowhere me/mine",
    "hub pull me/mine --out out",
    "leaderboard build --folder nowhere",
    "submit run nowhere",
    "leaderboard verify --folder nowhere",
    "leaderboard break ally/idle agent --name Me --author Me --folder nowhere",
    "leaderboard close-season 9 --work work --folder nowhere",
    "leaderboard season season-9 --folder nowhere",
)
WRONG = "discretely"
# Options of any text, and those of others: names that are given, addresses, and what a server is asked
FREE = {"--name", "--study-name", "--storage", "--address", "--server", "--allow", "--prompt"}
FREE |= {"--since", "--revision"}


def is_text(parameter: Any) -> bool:
    """Return True for a parameter that takes a word, not a number, a flag or a path."""
    kind = parameter.type_descriptor.annotation
    return str in (kind, *get_args(kind)) and not getattr(parameter, "is_flag", False)


def misspelt() -> Iterator[str]:
    """Working command lines, each with a wrong word for one of its arguments or options."""
    for line in WORKING:
        given = line.split()
        (words, command), *_ = (each for each in verbs() if tuple(given[: len(each[0])]) == each[0])
        arguments = [each for each in command.params if each.param_type_name == "argument"]
        for index, each in enumerate(arguments, len(words)):
            if is_text(each) and index < len(given):
                yield " ".join([*given[:index], WRONG, *given[index + 1 :]])
        for option in command.params:
            if option.param_type_name == "option" and is_text(option) and option.opts[0] not in FREE:
                yield f"{line} {option.opts[0]} {WRONG}"


@pytest.mark.slow
@pytest.mark.parametrize("line", list(misspelt()))
def test_a_wrong_word_is_refused_in_one_line_before_anything_is_written(line, monkeypatch, capfd, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "app", COMMAND)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(sys, "argv", ["fpg-bench", *line.split()])
    with pytest.raises(SystemExit) as end:
        cli.main()
    error = capfd.readouterr().err
    *_, last = error.splitlines()
    assert (end.value.code, last[:11]) == (2, "fpg-bench: "), error
    assert error.count("fpg-bench: ") == 1
    assert not list(tmp_path.iterdir())


def test_each_verb_that_takes_words_has_a_line_that_works():
    for words, command in verbs():
        known = any(tuple(line.split()[: len(words)]) == words for line in WORKING)
        free = all(each.opts[0] in FREE for each in command.params if is_text(each))
        assert known or free, " ".join(words)
