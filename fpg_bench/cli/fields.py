"""Options of verbs from the fields of dataclasses, the one home of their types, defaults and words."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

Given = Mapping[str, Any]  # values of fields, by name
HELP_ALL = "help_all"
_MANY = 24  # options that --help shows at once
_TEXT = ("str", "Any", "Hyperparams")
_TYPES = {"int": int, "float": float, "bool": bool, "Collection[str]": list[str], "Path": Path}


@dataclasses.dataclass(frozen=True)
class Fields:
    """Annotation of a verb's parameter that stands for fields of a dataclass, each an option of its own.

    ``Annotated[Workers, Fields(Workers)]`` passes the dataclass, with the defaults of the parameter's default
    if it has one; ``Annotated[Given, Fields(GameSpec, ("path", "planner"))]`` passes the values by name.

    Attributes:
        kind: the dataclass. The first sentence on a field in its docstring is the option's help.
        names: the fields; None: all.
        lists: fields that take several words, separated by commas.
        panel: panel of the options in ``--help``.
        details: further arguments of :func:`typer.Option` by field.
    """

    kind: type
    names: tuple[str, ...] | None = None
    lists: tuple[str, ...] = ()
    panel: str | None = None
    details: Mapping[str, Given] = dataclasses.field(default_factory=dict)

    def parameters(self, default: Any, is_whole: bool) -> list[inspect.Parameter]:
        """Return the options as typer reads them; each field that is absent has the value of ``default``.

        Of values by name an absent one is None, so that a value that equals the default counts as given.

        Raises:
            TypeError: a field has a type that no option is made for.
        """
        docs, parameters = first_sentences(self.kind), []
        for field in dataclasses.fields(self.kind):
            if self.names is not None and field.name not in self.names:
                continue
            kind = self._type_of(field)
            help = docs[field.name] + " Several are separated by commas." * (field.name in self.lists)
            help += " May be repeated." * (kind == list[str])
            details = {"help": help, "rich_help_panel": self.panel} | dict(self.details.get(field.name, {}))
            value = field.default if isinstance(default, type) else getattr(default, field.name)
            if not is_whole and value not in (None, ()):
                details["show_default"], value = str(value), None
            of = kind | None if value in (None, ()) else kind
            annotation: Any = Annotated[of, typer.Option(**details)]
            parameters.append(_keyword(field.name, annotation, None if value == () else value))
        return parameters

    def _type_of(self, field: dataclasses.Field[Any]) -> Any:
        """Return the type of a field's option; text stands last, as in ``str | Path``."""
        kinds = str(field.type).split(" | ")
        for name in (*_TYPES, *_TEXT):
            if name in kinds:
                return _TYPES.get(name, str)
        raise TypeError(f"{self.kind.__name__}.{field.name}: no option has the type {field.type}")

    def collect(self, given: dict[str, Any]) -> Given:
        """Take the values of the fields out of those of all options; what is not given is left out."""
        names = [each.name for each in dataclasses.fields(self.kind) if each.name in given]
        values = {name: given.pop(name) for name in names if self.names is None or name in self.names}
        values = {name: value for name, value in values.items() if value is not None}
        words = {name: listed(values[name]) for name in self.lists if name in values}
        return values | words


def with_fields(verb: Callable[..., None]) -> Callable[..., None]:
    """Return a verb in whose signature :class:`Fields` are written out; it is called with all options."""
    parameters, groups = [], {}
    for name, parameter in inspect.signature(verb, eval_str=True).parameters.items():
        kind, *marks = get_args(parameter.annotation) or (parameter.annotation,)
        if marks and isinstance(marks[0], Fields):
            groups[name] = marks[0], kind is marks[0].kind
            parameters += marks[0].parameters(parameter.default, groups[name][1])
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    if len(parameters) > _MANY:
        parameters.append(_keyword(HELP_ALL, _HelpAll, False))

    @functools.wraps(verb)
    def call(**given: Any) -> None:
        given.pop(HELP_ALL, None)
        for name, (fields, is_whole) in groups.items():
            values = fields.collect(given)
            given[name] = fields.kind(**values) if is_whole else values
        verb(**given)

    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return call


def _show_all(ctx: typer.Context, is_given: bool) -> None:
    if is_given:
        ctx.meta[HELP_ALL] = True
        typer.echo(ctx.get_help())
        raise typer.Exit


_HelpAll = Annotated[
    bool, typer.Option("--help-all", is_eager=True, callback=_show_all, help="Show all options and exit.")
]


def first_sentences(kind: type) -> dict[str, str]:
    """Return the first sentence on each attribute in the docstrings of a class and its bases, as help.

    Where Python has dropped the docstrings (``-OO``), each is empty.
    """
    sections = [(inspect.getdoc(each) or "").partition("Attributes:\n")[2] for each in kind.__mro__[::-1]]
    text_of_all = "\n".join(section.split("\n\n")[0] for section in sections)
    sentences: dict[str, str] = defaultdict(str)
    for names, text in re.findall(r"^    ([\w, ]+): (.*(?:\n {8}.*)*)", text_of_all, re.MULTILINE):
        first = re.split(r"(?<=\.)\s", " ".join(text.replace("``", "").split()))[0].rstrip(".")
        first = first.replace("; None: ", ". Default: ")
        sentences |= dict.fromkeys(names.split(", "), f"{first[0].upper()}{first[1:]}.")
    return sentences


def listed(value: str | None) -> Any:
    """Split a comma-separated list; a single word and None are returned unchanged."""
    return [word.strip() for word in value.split(",")] if value is not None and "," in value else value


def _keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)
