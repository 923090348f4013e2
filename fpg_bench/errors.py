"""The error that a user can mend, and the hint at the word that was meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class UserError(ValueError):
    """Bad input: the message says in one line what is wrong, where, and what to write instead.

    The command line prints the message and exits with 2; every other exception is a bug.
    """


def nearest(word: str, known: Iterable[str]) -> str:
    """What to append to an error about an unknown word: the nearest known one, else all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(known)}"
