"""Errors that users can mend, and suggestions for misspelt words."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_NEAR = 0.6  # of difflib's ratio
_MOST = 30  # names in a line


class UserError(ValueError):
    """Bad input. The message says in one line what is wrong, where, and what to write instead.

    The command line prints the message and exits with 2; every other exception is a bug.

    >>> import fpg_bench
    >>> fpg_bench.preset("figure")
    Traceback (most recent call last):
    ...
    fpg_bench.game.scenario.ScenarioError: unknown scenario 'figure'; did you mean 'figures'?
    """


class UnknownOptionError(UserError, TypeError):
    """An unknown option of a call; also a TypeError, which frameworks that probe for one expect."""


def printable(text: str) -> str:
    """Return a text from outside with control characters and lone surrogates replaced."""
    return "".join(c if c.isprintable() or c == "\n" else "�" for c in text)


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

    Capitals do not matter. Of words as ``a/b`` the last parts must be near, too: all that lies in one
    folder begins alike.
    """
    near = {name.lower(): name for name in sorted(set(known)) if _ends_near(word.lower(), name.lower())}
    close = difflib.get_close_matches(word.lower(), near, n=1, cutoff=_NEAR)
    return f"; did you mean {near[close[0]]!r}?" if close else ""


def _ends_near(word: str, name: str) -> bool:
    """Return True if the last parts of two paths are similar, or the paths differ in depth."""
    if word.count("/") != name.count("/"):
        return True
    last, end = (text.rpartition("/")[2] for text in (word, name))
    return difflib.SequenceMatcher(None, last, end).ratio() >= _NEAR
