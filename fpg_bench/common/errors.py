"""Errors that users can mend, and suggestions for misspelt words."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_MOST = 30  # names in a line
_LONGEST = 80  # characters of a refused value in a message
_LONGEST_WORD = 300  # of anything in a message; paths may be long
_LAST = 20  # characters that are kept of its end
_LONG_WORD = re.compile(rf"\S{{{_LONGEST_WORD + 2 * _LAST},}}")


class UserError(ValueError):
    """Bad input. The message says in one line what is wrong, where, and what to write instead.

    The command line prints the message and exits with 2; every other exception is a bug. What a file or a
    caller put into the message is made printable, and cut where it is long.

    >>> import fpg_bench
    >>> fpg_bench.preset("figure")
    Traceback (most recent call last):
    ...
    fpg_bench.game.scenario.ScenarioError: unknown scenario 'figure'; did you mean 'figures'?
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(bounded(str(message)))


class UnknownOptionError(UserError, TypeError):
    """An unknown option of a call; also a TypeError, which frameworks that probe for one expect."""


def other_content(where: object, content: str, remedy: str = "") -> UserError:
    """Return the error for a folder, or a file of it, that belongs to something else.

    Args:
        where: the folder or file.
        content: what it holds.
        remedy: what else than another folder would help.
    """
    return UserError(f"{where}: holds {content}; {f'{remedy}, or ' if remedy else ''}choose another folder")


def bounded(text: str) -> str:
    """Return a text as one printable line, with words such as names and numbers cut where they are long."""
    line = printable(" ".join(text.splitlines()))
    return _LONG_WORD.sub(lambda word: f"{word[0][:_LONGEST_WORD]}...{word[0][-_LAST:]}", line)


def printable(text: str) -> str:
    """Return a text from outside with control characters and lone surrogates replaced."""
    return "".join(c if c.isprintable() or c == "\n" else "�" for c in text)


def shown(value: object) -> str:
    """Return a refused value as it stands in a message: its ``repr``, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def one_line(error: BaseException) -> str:
    """Return the message of an exception in one line; its type where it has none."""
    return " ".join(str(error).split()) or type(error).__name__


def first_line(error: BaseException) -> str:
    """Return the first line of an exception's message; its type where it has none."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)


def nearest(word: str, known: Iterable[str]) -> str:
    """Return the end of an error message on an unknown word: the nearest known word, or all of them.

    Of very many the first are named, and how many more there are.
    """
    known = sorted(set(known))
    more = f" and {len(known) - _MOST} more" if len(known) > _MOST else ""
    return meant(word, known) or f"; known: {', '.join(known[:_MOST])}{more}"


def meant(word: str, known: Iterable[str]) -> str:
    """Return the end of an error message on an unknown word: the nearest known word, or nothing.

    Capitals do not matter.
    """
    near = {name.lower(): name for name in sorted(set(known))}
    return "".join(
        f"; did you mean {near[close]!r}?" for close in difflib.get_close_matches(word.lower(), near, 1)
    )
