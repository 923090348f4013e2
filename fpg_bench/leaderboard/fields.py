"""``submission.yaml``: its keys, and what each of them may say."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from fpg_bench.checks import is_whole
from fpg_bench.errors import UserError, meant, nearest
from fpg_bench.leaderboard.folder import shown
from fpg_bench.leaderboard.lookalikes import skeleton, unseen

TRACKS = ("ally", "opponent", "planner")
PATHS = ("pursuit", "learned")
LONGEST_NAME = 60
_LONGEST_TEXT = 2000
MOST_STEPS, _MOST_HOURS, _MOST_SEED = 10**13, 10**6, 10**6
_MOST_SEEDS = 20
_MOST_RUNS = 10_000


@dataclass(frozen=True)
class Training:
    """What was spent on learning: environment steps and hours of each run, and the training seeds."""

    steps: int
    hours: float
    seeds: tuple[int, ...]


def read_fields(content: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The fields that are right, by key, and one line per thing that is wrong.

    Args:
        content: what ``submission.yaml`` holds.
    """
    found: list[str] = []
    for key in content:
        if key not in _CHECKS:
            hint = nearest(key, _CHECKS) if isinstance(key, str) else ""
            found.append(f"unknown key {shown(key)}{hint}")
    found += [f"lacks {key!r}" for key in _REQUIRED if key not in content]
    values: dict[str, Any] = {}
    for key in (key for key in _CHECKS if key in content):
        try:
            values[key] = _CHECKS[key](content[key])
        except UserError as error:
            found.append(f"{key}: {error}")
    return values, found + list(_together(content, values))


def plain(name: str) -> str:
    """A name without what the eye does not tell apart, see :mod:`fpg_bench.leaderboard.lookalikes`.

    What has no letter or digit keeps its signs: two names of signs are alike where they are the same.
    """
    return skeleton(name) or "".join(unicodedata.normalize("NFKC", name).casefold().split())


def _together(content: dict[str, Any], values: dict[str, Any]) -> list[str]:
    """What does not fit together."""
    found = []
    track = values.get("track")
    if track == "opponent" and "path" not in content:
        found.append("lacks 'path': pursuit or learned, which of the two tables it enters")
    if track in ("ally", "planner") and content.get("path") is not None:
        found.append(f"path: is of the track opponent only, not of {track}")
    if content.get("zoo") is not None and content.get("script") is not None:
        found.append("zoo, script: only one of them")
    if track == "planner" and content.get("zoo") is not None:
        found.append("zoo: its agents are no planners")
    trained = content.get("training") is not None
    recorded = track == "planner" and content.get("script") is None
    if recorded and content.get("runs") is None:
        found.append("lacks 'runs': how often the model was recorded for this, with the run that is entered")
    if track is not None and not recorded and content.get("runs") is not None:
        found.append("runs: is of a language model's transcripts only")
    if content.get("script") is not None and trained:
        found.append("training: a script is not trained; write null")
    if (
        content.get("script") is None
        and track in ("ally", "opponent")
        and "training" in content
        and not trained
    ):
        found.append("training: expected steps, hours and seeds, got null")
    return found


def _text(value: Any, most: int, lines: bool = False, least: int = 1) -> str:
    """Text of so many characters, all of which can be seen."""
    if not isinstance(value, str):
        raise UserError(f"expected text, got {shown(value)}; put it in quotes")
    value = value.strip()
    if not least <= len(value) <= most:
        raise UserError(f"expected {least} to {most} characters, got {len(value)}")
    for letter in value:
        if unicodedata.category(letter)[0] == "C" and not (lines and letter == "\n"):
            raise UserError(f"holds the control character U+{ord(letter):04X}; leave it out")
        if unseen(letter):
            raise UserError(f"holds U+{ord(letter):04X}, which cannot be seen; leave it out")
    return value


def _name(value: Any, most: int) -> str:
    """Text with a letter or a digit in it."""
    text = _text(value, most)
    if not any(unicodedata.category(letter)[0] in "LN" for letter in text):
        raise UserError(f"expected a letter or a digit at least, got {shown(text)}")
    return text


def _word(value: Any, choices: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in choices:
        hint = meant(value, choices) if isinstance(value, str) else ""
        raise UserError(f"expected {', '.join(choices)}, got {shown(value)}{hint}")
    return value


def _authors(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= 20:
        raise UserError(f"expected a list of 1 to 20 names, got {shown(value)}")
    return tuple(_name(name, 80) for name in value)


def _link(value: Any) -> str | None:
    if value is None:
        return None
    text = _text(value, 300)
    try:
        parts = urlsplit(text)
        whole = parts.scheme == "https" and parts.hostname and parts.username is None
    except ValueError:
        whole = False
    if not whole or any(letter in text for letter in " \"'<>\\`"):
        raise UserError(f"expected null or a link that begins with https://, got {shown(text)}")
    return text


def _training(value: Any) -> Training | None:
    if value is None:
        return None
    keys = ("steps", "hours", "seeds")
    if not isinstance(value, dict):
        raise UserError(f"expected null or steps, hours and seeds, got {shown(value)}")
    for key in value:
        if key not in keys:
            raise UserError(f"unknown key {shown(key)}; known: {', '.join(keys)}")
    if missing := [key for key in keys if key not in value]:
        raise UserError(f"lacks {', '.join(missing)}")
    seeds = value["seeds"]
    if not isinstance(seeds, list) or not 1 <= len(seeds) <= _MOST_SEEDS:
        raise UserError(f"seeds: expected a list of 1 to {_MOST_SEEDS} whole numbers, got {shown(seeds)}")
    checked = tuple(int(_number(seed, "seeds", 0, _MOST_SEED, whole=True)) for seed in seeds)
    if len(set(checked)) < len(checked):
        raise UserError(f"seeds: one stands there twice: {shown(seeds)}")
    steps = int(_number(value["steps"], "steps", 1, MOST_STEPS, whole=True))
    return Training(steps, _number(value["hours"], "hours", 0, _MOST_HOURS), checked)


def _runs(value: Any) -> int:
    if not is_whole(value, 1) or value > _MOST_RUNS:
        raise UserError(f"expected a whole number from 1 to {_MOST_RUNS:,}, got {shown(value)}")
    return int(value)


def _number(value: Any, name: str, least: int, most: int, whole: bool = False) -> float:
    kinds = int if whole else (int, float)
    fits = isinstance(value, kinds) and not isinstance(value, bool) and least <= value <= most
    if not fits or not math.isfinite(value):
        kind = "a whole number" if whole else "a number"
        raise UserError(f"{name}: expected {kind} from {least} to {most:,}, got {shown(value)}")
    return value


def _optional(check: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else check(value)


_LONG = partial(_text, most=_LONGEST_TEXT, lines=True)
_CHECKS: dict[str, Callable[[Any], Any]] = {
    "name": partial(_name, most=LONGEST_NAME),
    "authors": _authors,
    "algorithm": partial(_text, most=60),
    "reference": _link,
    "licence": partial(_text, most=60),
    "track": partial(_word, choices=TRACKS),
    "path": _optional(partial(_word, choices=PATHS)),
    "training": _training,
    "saw": _LONG,
    "unable": _LONG,
    "description": partial(_text, most=_LONGEST_TEXT, lines=True, least=0),
    "zoo": _optional(partial(_text, most=100)),
    "script": _optional(partial(_text, most=100)),
    "runs": _optional(_runs),
}
_REQUIRED = tuple(key for key in _CHECKS if key not in ("path", "description", "zoo", "script", "runs"))
