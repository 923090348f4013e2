"""Contents of ``submission.yaml``: what an entry says of itself, every text of which is untrusted."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Annotated
from urllib.parse import urlsplit

from annotated_types import Ge, Le, Len
from pydantic import AfterValidator, BeforeValidator, PlainValidator

from fpg_bench.common.checks import title
from fpg_bench.common.errors import UserError, meant, nearest, shown
from fpg_bench.common.schema import Expected, Items, Strict, problems_of
from fpg_bench.players.card import MOST_SECONDS, MOST_STEPS
from fpg_bench.products.leaderboard.folders import TRACK_FOLDERS
from fpg_bench.products.leaderboard.tracks import SCENARIOS

PATHS = ("pursuit", "learned")
_ALIKE = str.maketrans({"0": "o", "1": "i", "l": "i", "j": "i", "|": "i", "!": "i"})
# Blocks (first, last) of letters and marks that are invisible; others are controls or spaces by category.
_INVISIBLE = (
    *((0x34F, 0x34F), (0x115F, 0x1160), (0x17B4, 0x17B5), (0x180B, 0x180F), (0x2800, 0x2800)),
    *((0x3164, 0x3164), (0xFE00, 0xFE0F), (0xFFA0, 0xFFA0), (0x1D159, 0x1D159), (0xE0000, 0xE0FFF)),
)


def name_skeleton(name: str) -> str:
    """Return a name in ASCII without differences that the eye overlooks: case, spaces, punctuation.

    Similar characters become one: 0 is o, 1 and l are i, ``rn`` is ``m``, ``vv`` is ``w``. A name without
    letters and digits keeps its signs.
    """
    plain = name.casefold().translate(_ALIKE)
    kept = "".join(letter for letter in plain if unicodedata.category(letter)[0] in "LNS")
    return kept.replace("rn", "m").replace("vv", "w") or "".join(plain.split())


def board_name(about: SubmissionFile, slug: str) -> str:
    """Return the name on the board: for an agent of the package that by which the command line plays it.

    Another entry of the same agent adds what its folder's name has more.
    """
    if about.zoo is None:
        return about.name
    group, _, algorithm = about.zoo.partition("/")
    rest = slug.removeprefix(group).removeprefix(f"-{algorithm}").strip("-")
    return f"{about.zoo} ({rest})" if rest else about.zoo


# Values


def _text(value: object, most: int, lines: bool = False, least: int = 1) -> str:
    """Return stripped text of ``least`` to ``most`` characters, all of which are visible."""
    if not isinstance(value, str):
        raise UserError(f"expected text, got {shown(value)}; put it in quotes")
    value = value.strip()
    if not least <= len(value) <= most:
        raise UserError(f"expected {least} to {most} characters, got {len(value)}")
    for letter in value:
        if unicodedata.category(letter)[0] == "C" and not (lines and letter == "\n"):
            raise UserError(f"holds the control character U+{ord(letter):04X}; leave it out")
        if any(first <= ord(letter) <= last for first, last in _INVISIBLE):
            raise UserError(f"holds U+{ord(letter):04X}, which cannot be seen; leave it out")
    return value


def _named(value: object, most: int) -> str:
    """Return text with a letter or a digit in it."""
    text = _text(value, most)
    if not any(unicodedata.category(letter)[0] in "LN" for letter in text):
        raise UserError(f"must contain at least one letter or digit, got {shown(text)}")
    return text


def _entry_name(value: object) -> str:
    text = _named(value, 60)
    if odd := [letter for letter in text if not letter.isascii()]:
        raise UserError(f"{shown(text)} holds {odd[0]!r}; a name is written in ASCII")
    return title(text)


def _choice(value: object, choices: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in choices:
        hint = meant(value, choices) if isinstance(value, str) else ""
        raise UserError(f"expected {', '.join(choices)}, got {shown(value)}{hint}")
    return value


def _authors(value: object) -> tuple[str, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= 20:
        raise UserError(f"expected a list of 1 to 20 names, got {shown(value)}")
    return tuple(_named(name, 80) for name in value)


def _link(value: object) -> str:
    text = _text(value, 300)
    try:
        parts = urlsplit(text)
        is_complete = parts.scheme == "https" and parts.hostname and parts.username is None
    except ValueError:
        is_complete = False
    if not is_complete or any(letter in text for letter in " \"'<>\\`"):
        raise UserError(f"expected null or a link that begins with https://, got {shown(text)}")
    return text


def _distinct(seeds: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(seeds)) < len(seeds):
        raise UserError(f"duplicate seed in {shown(list(seeds))}")
    return seeds


_Word = Annotated[str, PlainValidator(partial(_text, most=60))]
_Lines = Annotated[str, PlainValidator(partial(_text, most=2000, lines=True))]
_Shipped = Annotated[str, PlainValidator(partial(_text, most=100))] | None
_Seeds = Annotated[
    Items[Annotated[int, Ge(0), Le(10**6)]],
    Len(1, 20),
    Expected("a list of 1 to 20 whole numbers from 0 to 1,000,000"),
    AfterValidator(_distinct),
]


Title = Annotated[str, PlainValidator(_entry_name)]
Authors = Annotated[tuple[str, ...], BeforeValidator(_authors)]


class ResponseFile(Strict):
    """Contents of ``response.yaml``; every text in it is untrusted.

    Attributes:
        name: what the board calls the attacker, whose responses to several entries have one name.
        seconds: CPU seconds of the search.
    """

    name: Title
    authors: Authors
    seconds: Annotated[float, Ge(0), Le(MOST_SECONDS), Expected("CPU seconds of the search")]


class Training(Strict):
    """Cost of training: environment steps and hours of each run, and the training seeds."""

    steps: Annotated[int, Ge(1), Le(MOST_STEPS), Expected(f"a whole number from 1 to {MOST_STEPS:,}")]
    hours: Annotated[int | float, Ge(0), Le(10**6), Expected("a number from 0 to 1,000,000")]
    seeds: _Seeds


class SubmissionFile(Strict):
    """Contents of ``submission.yaml``; every text in it is untrusted.

    Attributes:
        name: the title on the board.
        reference: an https link, or None.
        track: ``ally``, ``opponent`` or ``planner``.
        path: in the track ``opponent``, how it flies: ``pursuit`` or ``learned``; else None.
        scenario: the preset that it plays: ``standard`` or ``link``.
        training: None if nothing was trained.
        saw: the players, paths and scenarios that it was trained against.
        unable: its limitations.
        zoo: the package's own agents that it enters, such as ``ally-scripted/ppo``, or None.
        script: the package's own player or planner that it enters, or None.
        runs: the number of recordings of a language model, as its authors state it; None for others.
    """

    name: Title = ""
    authors: Authors = ()
    algorithm: Annotated[_Word, AfterValidator(title)] = ""
    reference: Annotated[str, PlainValidator(_link)] | None = None
    licence: _Word = ""
    track: Annotated[str, PlainValidator(partial(_choice, choices=TRACK_FOLDERS))] = ""
    path: Annotated[str, PlainValidator(partial(_choice, choices=PATHS))] | None = None
    scenario: Annotated[str, PlainValidator(partial(_choice, choices=SCENARIOS))] = "standard"
    training: Training | None = None
    saw: _Lines = ""
    unable: _Lines = ""
    description: Annotated[str, PlainValidator(partial(_text, most=2000, lines=True, least=0))] = ""
    zoo: _Shipped = None
    script: _Shipped = None
    runs: Annotated[int | None, Ge(1), Le(10_000), Expected("a whole number from 1 to 10,000")] = None

    @property
    def is_recorded(self) -> bool:
        """True for a language model that plans, which is entered by its transcripts."""
        return self.track == "planner" and self.script is None


_OPTIONAL = ("path", "scenario", "description", "zoo", "script", "runs")
REQUIRED = tuple(key for key in SubmissionFile.model_fields if key not in _OPTIONAL)


def read_about(content: Mapping[str, object]) -> tuple[SubmissionFile, list[str]]:
    """Return the valid part of ``submission.yaml``, and one line per problem.

    Args:
        content: the mapping in ``submission.yaml``.
    """
    lines = []
    for key in content:
        if key not in SubmissionFile.model_fields:
            hint = nearest(key, SubmissionFile.model_fields) if isinstance(key, str) else ""
            lines.append(f"unknown key {shown(key)}{hint}")
    lines += [f"lacks {key!r}" for key in REQUIRED if key not in content]
    known = {key: content[key] for key in SubmissionFile.model_fields if key in content}
    about, wrong = problems_of(SubmissionFile, known)
    return about, lines + wrong + list(_contradictions(content, about))


def _contradictions(content: Mapping[str, object], about: SubmissionFile) -> Iterator[str]:
    """Yield problems of keys that do not fit together."""
    given = {key for key, value in content.items() if value is not None}
    if about.track == "opponent" and "path" not in given:
        yield "lacks 'path': pursuit or learned, which of the two tables it enters"
    if about.track in ("ally", "planner") and "path" in given:
        yield f"path: only allowed for the track opponent, not for {about.track}"
    if about.track == "planner" and about.scenario != "standard":
        yield f"scenario: planners play standard, not {about.scenario}"
    if about.scenario != "standard" and about.path == "learned":
        yield f"path: opponents in {about.scenario} must have the path pursuit"
    if {"zoo", "script"} <= given:
        yield "zoo, script: only one of them"
    if about.track == "planner" and "zoo" in given:
        yield "zoo: not allowed for planners; the zoo has none"
    is_recorded = about.is_recorded and "script" not in given  # a script that is invalid is given, too
    if is_recorded and "runs" not in given:
        yield "lacks 'runs': number of recordings made, including the submitted one"
    if about.track and not is_recorded and "runs" in given:
        yield "runs: only allowed for transcripts of a language model"
    if {"script", "training"} <= given:
        yield "training: a script is not trained; write null"
    is_trained = about.track in ("ally", "opponent") and "script" not in given
    if is_trained and "training" in content and "training" not in given:
        yield "training: expected steps, hours and seeds, got null"
