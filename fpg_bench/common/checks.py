"""What users write, in files and in calls, is checked here: keys, whole numbers, words, truth values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from numbers import Integral
from typing import Any

from fpg_bench.common.errors import UserError, nearest


def is_whole(value: Any, least: int = 1) -> bool:
    """Whether a value is a whole number of at least ``least``; a truth value is none."""
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


def whole(value: Any, where: str, least: int = 1) -> int:
    """The value, a whole number of at least ``least``; raises UserError for all else, ``where`` begins it."""
    if not is_whole(value, least):
        bound = "a whole number above 0" if least == 1 else f"a whole number, {least} or more"
        raise UserError(f"{where}: expected {bound}, got {value!r}")
    return int(value)


def flag(value: Any, where: str) -> bool:
    """The value, true or false; raises UserError for all else."""
    if not isinstance(value, bool):
        raise UserError(f"{where}: expected true or false, got {value!r}")
    return value


def mapping(value: Any, where: str) -> Mapping[Any, Any]:
    """The value, a mapping; raises UserError for all else."""
    if not isinstance(value, Mapping):
        raise UserError(f"{where}: expected a mapping, got {value!r}")
    return value


def check_keys(content: Any, known: Collection[str], where: str, needed: Collection[str] = ()) -> None:
    """Raise UserError for a key that is not known, with the nearest one, or for one that is needed and lacks.

    Args:
        content: what was read; anything but a mapping is refused, too.
        known: the keys that may stand there.
        where: begins the message.
        needed: those of them that must.
    """
    for key in mapping(content, where):
        if key not in known:
            raise UserError(f"{where}: unknown key {key!r}{nearest(str(key), known)}")
    if missing := [key for key in needed if key not in content]:
        raise UserError(f"{where}: lacks {', '.join(missing)}")
