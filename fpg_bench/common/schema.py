"""Validation of data from outside with pydantic, and one clear line about the first problem."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic import Strict as PydanticStrict
from pydantic_core import ErrorDetails, core_schema

from fpg_bench.common.errors import UserError, meant, nearest, shown

T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument", "invalid_key")
_RAISED = ("value_error", "assertion_error")  # by a validator of a model: its message says it all
_ABSENT = object()


class Strict(BaseModel):
    """Base class of models of files: frozen, without conversions; unknown keys, NaN and infinity are refused.

    A list in a file becomes a tuple with :data:`Items`. Validators of a model raise UserError; its message
    follows the key's path.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


@dataclasses.dataclass(frozen=True)
class Expected:
    """Annotation that words what a value must be: ``Annotated[int, Field(ge=1), Expected("a count")]``."""

    description: str

    def __get_pydantic_core_schema__(
        self, kind: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Wrap the schema of the annotated type so that all its errors become this one."""
        return core_schema.custom_error_schema(
            handler(kind),
            custom_error_type="expected",
            custom_error_message="{expected}",
            custom_error_context={"expected": self.description},
        )


PositiveInt = Annotated[int, Field(ge=1), Expected("a whole number above 0")]
NonNegativeInt = Annotated[int, Field(ge=0), Expected("a whole number, 0 or more")]


def _check_printable(text: str) -> str:
    if not text.isprintable():
        raise UserError("expected printable text")
    return text


# A name, or another word, in a record or a table
Word = Annotated[str, PydanticStrict(), Field(min_length=1, max_length=200), AfterValidator(_check_printable)]
Items = Annotated[tuple[T, ...], Field(strict=False)]


def parse(kind: type[T], data: object, where: str) -> T:
    """Validate data against a model or a type.

    Args:
        kind: a pydantic model, or another type.
        data: what was read from a file or given by a caller.
        where: what is validated; begins the message.

    Returns:
        The validated object.

    Raises:
        UserError: the first problem: an unknown key (with the nearest known one), else missing keys,
            else a value with its path, what was expected, and what was found instead.
    """
    try:
        validated: T = _adapter(typing.cast(Any, kind)).validate_python(data)
        return validated
    except ValidationError as error:
        raise UserError(f"{where}: {wording(error, kind, data)}") from None


def wording(error: ValidationError, kind: object = object, data: object = None) -> str:
    """Describe the first problem of data that were validated as a kind, see :func:`parse`."""
    return _problem(kind, data, error.errors(include_url=False))


def problems_of(model: type[M], data: Mapping[str, object]) -> tuple[M, list[str]]:
    """Validate a mapping key by key and describe all problems, not only the first.

    Args:
        model: a model all of whose fields have defaults.
        data: known keys only; validators of the whole model must not refuse what its fields accept.

    Returns:
        The model of all valid keys, with the defaults for the others, and one line per invalid key.
    """
    try:
        return model.model_validate(dict(data)), []
    except ValidationError as error:
        errors = error.errors(include_url=False)
    by_key: dict[int | str, list[ErrorDetails]] = {}
    for detail in errors:
        by_key.setdefault(detail["loc"][0], []).append(detail)
    lines = [_problem(model, data, details) for details in by_key.values()]
    valid = [key for key in data if isinstance(key, str) and key not in by_key]
    return model.model_validate({key: data[key] for key in valid}), lines


@functools.lru_cache(maxsize=256)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _problem(kind: object, data: object, errors: Sequence[ErrorDetails]) -> str:
    """Describe the problem to mend first: unknown keys, then missing ones, then values."""
    located = [(_path(data, error), error) for error in errors]
    for path, error in located:
        if error["type"] in _UNKNOWN:
            known = _known_keys(kind, error["loc"][:-1])
            return _at(path[:-1], f"unknown key {path[-1]!r}{nearest(str(path[-1]), known) if known else ''}")
    if absent := [path for path, error in located if error["type"] == "missing"]:
        parent = absent[0][:-1]
        keys = [str(path[-1]) for path in absent if path[:-1] == parent]
        return _at(parent, f"lacks {', '.join(keys)}")
    first = located[0][0]
    inside = [path for path, _ in located if len(path) > len(first) and path[: len(first)] == first]
    path = inside[0] if inside else first  # of a union, the member that reads furthest
    same = [error for other, error in located if other == path]
    if raised := [error for error in same if error["type"] in _RAISED]:
        return _at(path, str(raised[0].get("ctx", {}).get("error") or raised[0]["msg"]))
    expected = dict.fromkeys(map(_expected, same))
    value = same[0]["input"]
    hint = next((_hint(error) for error in same if error["type"] == "literal_error"), "")
    return _at(path, f"expected {' or '.join(expected)}, got {shown(value)}{hint}")


def _path(data: object, error: ErrorDetails) -> tuple[int | str, ...]:
    """Return the error's location without the names of a union's members, which are not in the data."""
    parts: list[int | str] = []
    value: object = data
    location = error["loc"]
    for index, part in enumerate(location):
        inner = _item(value, part)
        if inner is not _ABSENT:
            value = inner
            parts.append(part)
        elif error["type"] in ("missing", *_UNKNOWN) and index == len(location) - 1:
            parts.append(part)
    return tuple(parts)


def _item(value: Any, part: int | str) -> object:
    if isinstance(value, dict):
        return value.get(part, _ABSENT)
    is_index = isinstance(part, int) and isinstance(value, list | tuple) and part < len(value)
    return value[part] if is_index else _ABSENT


def _at(path: Sequence[int | str], problem: str) -> str:
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")
    return f"{text}: {problem}" if text else problem


_WORDS = {
    **dict.fromkeys(("expected", "literal_error", "enum"), "{expected}"),
    **dict.fromkeys(("int_type", "int_from_float", "int_parsing", "int_parsing_size"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    "finite_number": "a finite number",
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("string_type", "string_unicode"), "text"),
    "none_required": "nothing",
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type", "dataclass_type"), "a mapping"),
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "too_short": "a list of at least {min_length}",
    "too_long": "at most {max_length} items",
    "string_too_long": "at most {max_length} characters",
    "string_too_short": "at least {min_length} characters",
    "string_pattern_mismatch": "text of the form {pattern}",
    "union_tag_invalid": "{discriminator}: {expected_tags}",
    "union_tag_not_found": "a mapping with {discriminator}",
}


def _expected(error: ErrorDetails) -> str:
    """Word what the value should have been."""
    if error["type"] not in _WORDS:
        return str(error["msg"])
    text = _WORDS[error["type"]].format(**error.get("ctx", {}))
    return text if error["type"] == "string_pattern_mismatch" else text.replace("'", "")


def _hint(error: ErrorDetails) -> str:
    words = str(error["ctx"]["expected"]).replace(" or ", ", ").split(", ")
    value = error["input"]
    return meant(value, [word.strip("'") for word in words]) if isinstance(value, str) else ""


def _known_keys(kind: object, location: Sequence[int | str]) -> set[str]:
    """Return the keys of the models, dataclasses or typed dictionaries at a location inside a type."""
    kinds = list(_structures(kind))
    for part in location:
        named = [name for name in kinds if isinstance(part, str) and part == getattr(name, "__name__", "")]
        inner = [fields[str(part)] for fields in map(_fields, named or kinds) if part in fields]
        kinds = [structure for field in inner for structure in _structures(field)] or named or kinds
    return {key for structure in kinds for key in _fields(structure)}


def _structures(kind: object) -> Iterator[type]:
    """Yield the types with named keys in an annotation, through unions, lists and mappings."""
    if isinstance(kind, type) and _fields(kind):
        yield kind
    for inner in typing.get_args(kind):
        yield from _structures(inner)


def _fields(kind: object) -> dict[str, Any]:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
    if dataclasses.is_dataclass(kind) or typing.is_typeddict(kind):
        return dict(typing.get_type_hints(kind))
    return {}
