"""``submission.yaml``: its keys, and what each of them may say.

Names are compared as the eye takes them: letters that look alike are one letter, and what cannot be seen is
none. The idea is that of the skeletons of Unicode's UTS #39. Its table of thousands is cut down to the
scripts that have letters like Latin ones; NFKC and case folding do the rest.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from fpg_bench.common.checks import is_whole
from fpg_bench.common.errors import UserError, meant, nearest
from fpg_bench.leaderboard.folder import shown

TRACKS = ("ally", "opponent", "planner")
PATHS = ("pursuit", "learned")
LONGEST_NAME = 60
_LONGEST_TEXT = 2000
MOST_STEPS, _MOST_HOURS, _MOST_SEED = 10**13, 10**6, 10**6
_MOST_SEEDS = 20
_MOST_RUNS = 10_000
# Each Latin letter with what looks like it, folded; 0 is o, and 1 is i as l is.
_ALIKE = {
    "a": "аαɑᴀⲁꭺ",
    "b": "ьвʙᏏᏴꮟ",
    "c": "сϲᴄⲥꮯ",
    "d": "ԁᏧꭰ",
    "e": "еєεҽᴇꭼ",
    "f": "ғϝꞙẝ",
    "g": "ɡցᶃꮐ",
    "h": "һհнʜᎻꮋ",
    "i": "іıɩιⲓꭵjјl1ӏ|ɪǀ!",
    "k": "кκᴋⲕꮶ",
    "m": "мᴍⲙꮇ",
    "n": "пηոռᴎⲛɴ",
    "o": "оοσօᴏⲟסߋ০๐໐0ჿ",
    "p": "рρϱᴘⲣꮲ",
    "q": "ԛզգ",
    "r": "гᴦⲅꭇꮁ",
    "s": "ѕꜱꮪʂ",
    "t": "тτᴛⲧꭲ",
    "u": "υսᴜꭎʋ",
    "v": "ѵνᴠꮩ",
    "w": "ѡωԝɯᴡꮃ",
    "x": "хχⲭ×",
    "y": "уүγʏⲩყ",
    "z": "ᴢꮓ",
}
_SKELETON = str.maketrans({other: letter for letter, others in _ALIKE.items() for other in others})
# Letters and marks that show nothing, in blocks (first, last); all others are controls or spaces by category.
_UNSEEN = (
    *((0x34F, 0x34F), (0x115F, 0x1160), (0x17B4, 0x17B5), (0x180B, 0x180F), (0x2800, 0x2800)),
    *((0x3164, 0x3164), (0xFE00, 0xFE0F), (0xFFA0, 0xFFA0), (0x1D159, 0x1D159), (0xE0000, 0xE0FFF)),
)


@dataclass(frozen=True)
class Training:
    """What was spent on learning: environment steps and hours of each run, and the training seeds."""

    steps: int
    hours: float
    seeds: tuple[int, ...]


def read_fields(content: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The suites that are right, by key, and one line per thing that is wrong.

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
    """A name without what the eye does not tell apart.

    What has no letter or digit keeps its signs: two names of signs are alike where they are the same.
    """
    return _skeleton(name) or "".join(unicodedata.normalize("NFKC", name).casefold().split())


def _skeleton(name: str) -> str:
    """What is left of a name for the eye: no case, space, accent, punctuation or script; ``rn`` is ``m``."""
    whole = unicodedata.normalize("NFKC", name.translate(_SKELETON)).casefold()
    letters = (c for c in unicodedata.normalize("NFD", whole) if _is_seen(c))
    return "".join(letters).translate(_SKELETON).replace("rn", "m").replace("vv", "w")


def _is_seen(letter: str) -> bool:
    return (unicodedata.category(letter)[0] in "LNS" or letter == "!") and not _is_unseen(letter)


def _is_unseen(letter: str) -> bool:
    """Whether a character leaves nothing on the page though it is no space and no control."""
    return any(first <= ord(letter) <= last for first, last in _UNSEEN)


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
        if _is_unseen(letter):
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
