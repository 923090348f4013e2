"""Parsing of a language model's answers into waypoints, without inventing any.

The model's reasoning is left out. The answer is then what stands last: the text after the last ``Next
directions:`` if there is one, and within it the last JSON object with ``waypoints`` or fenced block. JSON is
read strictly; any other text by its bracketed triples, which must be exactly as many as asked for, since it
cannot be known which of them are the path. The answer names the rule that was broken. No pattern backtracks
far: each reads any text in time linear in its length.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpg_bench.common.strict_json import Json
from fpg_bench.players.planner import Array, Limits, Request

READ_CHARS = 200_000  # about 2000 waypoints as indented JSON; a longer answer is not read
BOX_SLACK = 0.05  # by the box's side: a point this far outside is moved in

# Signs that a valid path is of no use
EXAMPLE, STILL, UNFLYABLE, REPEATED = "example", "still", "unflyable", "repeated"
STILL_M = 10.0  # largest distance to its middle of a path that stands still
SAME_M = 1.0  # a point this near to another is a copy of it: prompts hold whole metres
_MOST = 0.75  # share of a path's points from which most of them are copies
_FAR = 1.01  # a leg longer than this factor times what can be flown is too long: points are whole metres

Point = tuple[float, ...] | None  # three numbers, or None: something else in a point's place


@dataclass(frozen=True)
class Answer:
    """A parsed answer.

    Attributes:
        waypoints: ``(n, 3)`` in m, inside the box; None: no valid path.
        rung: where the points stood: ``json``, after the ``directions``, ``triples`` elsewhere, or ``none``:
            no points at all.
        repaired: surplus points were left out, or points just outside the box moved in.
        problem: the rule that was broken, for the model to mend; None where the path is valid.
        refused: there are no points, and the text reads like a refusal.
    """

    waypoints: Array | None
    rung: str
    repaired: bool = False
    problem: str | None = None
    refused: bool = False


def read_answer(text: str, limits: Limits) -> Answer:
    """Read the waypoints in a model's answer; never raises, whatever the text.

    A remainder of more than ``READ_CHARS`` characters, without the reasoning, is not valid.

    Args:
        text: what the model wrote.
        limits: of the path that was asked for.
    """
    answer = _without_thoughts(text).translate(_ASCII).strip()
    if len(answer) > READ_CHARS:
        problem = f"the answer has {len(answer)} characters, but at most {READ_CHARS} are read"
        return Answer(None, "none", problem=problem)
    rung, points = _read_last(answer)
    if points is not None:
        return _checked(points, rung, limits)
    problem = f"no points found, expected {limits.waypoints}"
    return Answer(None, "none", problem=problem, refused=bool(_REFUSAL.search(answer)))


def points_in(text: str) -> Array:
    """Return all points in brackets of a text, ``(m, 3)``, whether they make a path or not."""
    return np.array(_triples(text) or np.zeros((0, 3)), float)


def answer_schema(limits: Limits) -> Json:
    """Return the JSON schema of an answer: exactly n objects {x, y, z} of whole metres inside the box.

    Flat, with integers: servers that enforce a schema do not enforce the bounds of other numbers.
    """
    sides = {
        axis: {"type": "integer", "minimum": 0, "maximum": math.floor(side)}
        for axis, side in zip("xyz", limits.box_m, strict=True)
    }
    count = {"minItems": limits.waypoints, "maxItems": limits.waypoints}
    return _object({"waypoints": {"type": "array", "items": _object(sides), **count}})


def _object(properties: Json) -> Json:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


# Reasoning

# Marks of reasoning in the answers of open models: <think>, <thought>, <seed:think>, [THINK], ◁think▷,
# <|START_THINKING|>, <|begin_of_thought|>, channels other than the final one, and others like them. Some are
# lost where a server leaves special tokens out: "analysis... assistantfinal".
_WORDS = (
    r"(?:think(?:ing)?|thoughts?|reason(?:ing)?|reflection|analysis|scratch_?pad|monologue|chain_of_thought)"
)
_THOUGHTS = re.compile(
    rf"""
      (?P<end><\|?(?:end(?:_of)?_{_WORDS}|{_WORDS}_end|inner_suffix|unused95)\|?>)
    | <\|?(?:{_WORDS}_(?:start|begin)|inner_prefix|unused94)\|?>
    | <\|?(?P<tag>/?)(?:\w{{1,20}}[:_-])?{_WORDS}(?:\s[^<>]{{0,99}})?\|?>
    | [\[◁◀](?P<bracket>/?)(?:think(?:ing)?|reasoning)[\]▷▶]
    | <\|channel\|?>\s*+(?:analysis|commentary|thought)\b
    | (?P<final><\|channel\|?>\s*+final\b|(?-i:assistantfinal)|\bHere(?:'s|\ is)\ my\ response:)
    | (?P<stop><\|end\|>|<channel\|>)
    """,
    re.IGNORECASE | re.VERBOSE,
)

# Full-width forms of ASCII, and the brackets, commas, quotes and minus that have none
_ASCII = {code: code - 0xFEE0 for code in range(0xFF01, 0xFF5F)} | str.maketrans(
    "【】〔〕〈〉《》、−“”‘’", "[][]<><>,-\"\"''"
)


def _without_thoughts(text: str) -> str:
    """Return the text outside reasoning.

    An end mark without a start closes all text before it, unless answers end with it as well (``stop``); a
    start mark without an end goes on to the end.
    """
    kept: list[str] = []
    start, thinking = 0, False
    for mark in _THOUGHTS.finditer(text):
        ends = any(mark.groupdict().values())
        if mark.lastgroup == "stop" and not thinking:
            continue
        if ends:
            start = mark.end()
            if mark.lastgroup == "final":
                kept.clear()
        elif not thinking:
            kept.append(text[start : mark.start()])
        thinking = not ends
    return " ".join(kept if thinking else [*kept, text[start:]])  # a space: digits must not join


# The parser


def _read_last(text: str) -> tuple[str, list[Point] | None]:
    """Return where the points that stand last were found, and the points; None: there are none."""
    if (path := _json_path(text)) is not None:
        return "json", path
    start = max((mark.end() for mark in _DIRECTIONS.finditer(text)), default=0)
    for rung, scope in [("directions", text[start:])] * bool(start) + [("triples", text)]:
        block = _last_block(scope)
        if (path := _json_path(block)) is not None:
            return "json", path
        if points := _triples(block):
            return rung, points
    return "none", None


def _last_block(text: str) -> str:
    """Return the last JSON object with ``waypoints``, or the last fenced block with points after it.

    An object that is cut short is what follows its key. Without any of these it is the whole text.
    """
    start, block = -1, text
    opened: list[list[int]] = []  # where each open object begins, and its own key waypoints ends
    for token in _OBJECTS.finditer(text):
        if token[0] == "{":
            opened.append([token.start(), -1])
        elif token["key"]:
            start, block = token.start(), text[token.end() :]
            if opened:
                opened[-1][1] = token.end()
        elif token[0] == "}" and opened:
            begin, key = opened.pop()
            if key >= 0:
                start, block = begin, text[begin : token.end()]
    at = 0
    for number, part in enumerate(text.split("```")):
        if number % 2 and at > start:
            fenced = _LANGUAGE.sub("", part, count=1)
            if _json_path(fenced) is not None or _triples(fenced):
                start, block = at, fenced
        at += len(part) + 3
    return block


def _json_path(text: str) -> list[Point] | None:
    """Return the path of a complete JSON text, the schema's object or its list alone; None for others."""
    content = _json(text)
    if isinstance(content, dict) and "waypoints" in content:
        items = content["waypoints"]
        return _json_points(items if isinstance(items, list) else [])
    if isinstance(content, list) and all(isinstance(item, list | dict) for item in content):
        return _json_points(content)
    return None


def _json(text: str) -> Any:
    """Return the content of JSON, in a code fence or not; None for other texts."""
    fenced = _FENCE.fullmatch(text)
    try:
        # Whole numbers as floats, too: Python refuses to read an int of more than 4300 digits
        return json.loads(fenced[1] if fenced else text, parse_int=float, parse_constant=float)
    except (ValueError, RecursionError):
        return None


def _json_points(items: list[Any]) -> list[Point]:
    return [_json_point(item) for item in items]


def _json_point(item: Any) -> Point:
    values: Any = [item.get(axis) for axis in "xyz"] if isinstance(item, dict) else item
    is_triple = isinstance(values, list) and len(values) == 3
    return tuple(values) if is_triple and all(type(value) is float for value in values) else None


def _triples(text: str) -> list[Point] | None:
    return [tuple(float(part) for part in match.groups() if part) for match in _TRIPLE.finditer(text)] or None


# Possessive repeats (++, *+) give nothing back, so a number is read whole and only once
_NUMBER = r"([-+]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:e[-+]?[0-9]++)?|[-+]?(?:nan|inf(?:inity)?)\b)"
_METRES = r"(?:\s*+(?:m|met(?:er|re)s?|米)\b)?"
_NEXT = r"(?:\s*+[,;]\s*+|\s++)"
_BRACKETED = _NEXT.join([_NUMBER + _METRES] * 3)
_LABELLED = _NEXT.join(rf"[\"']?{axis}[\"']?\s*+[=:]\s*+{_NUMBER}{_METRES}" for axis in "xyz")
# A triple before a colon and a number is a line of the prompt's history, repeated: a place and its reward
_TRIPLE = re.compile(
    rf"[\[(<{{]\s*+{_BRACKETED}\s*+[\])>}}](?!\s*+:\s*+[-+]?[0-9])|(?<!\w){_LABELLED}(?!\w)", re.IGNORECASE
)
_DIRECTIONS = re.compile(r"next[ _]directions[\"'*`]*+\s*+:", re.IGNORECASE)
_FENCE = re.compile(r"```(?:json)?\s(.*)```", re.IGNORECASE | re.DOTALL)
_OBJECTS = re.compile(r"""(?P<key>(["'])waypoints\2\s*+:)|"(?:[^"\\\n]|\\.)*+"?|[{}]""")
_LANGUAGE = re.compile(r"\A[\w+-]*+\s")
_REFUSAL = re.compile(
    r"\b(?:can'?t|cannot|won't|unable to|not able to|sorry|refuse|decline|against my)\b"
    r"|无法|不能|抱歉|对不起|拒绝",
    re.IGNORECASE,
)


# After the parser


def _checked(points: list[Point], rung: str, limits: Limits) -> Answer:
    n = limits.waypoints
    if len(points) < n or (len(points) > n and rung != "json"):
        return Answer(None, rung, problem=f"expected {n} points, got {len(points)}")
    asked = points[:n]
    for number, point in enumerate(asked, 1):
        problem = _problem(point, limits)
        if problem is not None:
            return Answer(None, rung, problem=f"point {number}: {problem}")
    read = np.array(asked, float)
    waypoints = np.clip(read, 0.0, limits.box_m) + 0.0  # no -0
    return Answer(waypoints, rung, repaired=len(points) > n or bool((waypoints != read).any()))


def _problem(point: Point, limits: Limits) -> str | None:
    if point is None:
        return "expected x, y and z, each a number"
    for axis, value, side in zip("xyz", point, limits.box_m, strict=True):
        if not math.isfinite(value):
            return f"{axis} is not a finite number"
        if not -BOX_SLACK * side <= value <= (1 + BOX_SLACK) * side:
            return f"{axis} = {value:g} lies outside the box, 0 to {side:g}"
    return None


# Use of a valid path


def uselessness(waypoints: Array, request: Request, example: Array, past: Iterable[Array]) -> str:
    """Return the first sign that a valid path is useless: a model may keep to the form without planning.

    Args:
        waypoints: ``(n, 3)`` in m, the path.
        request: that it answers.
        example: ``(m, 3)`` in m, the points of the prompt's example.
        past: ``(n, 3)`` in m each, the match's earlier paths.

    Returns:
        ``example``: more than one of its points is one of the example's; ``still``: all its points lie
        within 10 m of their middle; ``unflyable``: more than half of its legs are longer than the opponent
        flies in their time; ``repeated``: three quarters of its points are those of one path before, or of
        one past round as the history shows it. Empty: none of these.
    """
    if sum(_near(waypoints, point).any() for point in example) > 1:
        return EXAMPLE
    if (np.linalg.norm(waypoints - waypoints.mean(axis=0), axis=1) <= STILL_M).all():
        return STILL
    if _too_long(waypoints, request).mean() > 0.5:
        return UNFLYABLE
    earlier = [*past, *request.history[..., :3]]
    return REPEATED if any(_near(waypoints, path).mean() >= _MOST for path in earlier) else ""


def _near(waypoints: Array, other: Array) -> NDArray[np.bool_]:
    """Return for each point ``(n,)`` whether it is that of another path, or a given point."""
    is_near: NDArray[np.bool_] = np.abs(waypoints - other).max(axis=1) <= SAME_M
    return is_near


def _too_long(waypoints: Array, request: Request) -> NDArray[np.bool_]:
    """Return for each leg ``(n,)`` whether it is longer than what can be flown in its time."""
    due_s = np.diff(request.limits.due_s(), prepend=0.0)
    legs_m = np.linalg.norm(np.diff(waypoints, axis=0, prepend=request.current_position[None]), axis=1)
    is_too_long: NDArray[np.bool_] = legs_m > _FAR * request.limits.speed_m_s * due_s
    return is_too_long
