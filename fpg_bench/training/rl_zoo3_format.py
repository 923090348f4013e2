"""Values as rl-zoo3's files write them: expressions of Python are read, but never evaluated."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Any

from fpg_bench.common.errors import UserError, meant, nearest, one_line, shown

_LONGEST = 10_000  # characters of an expression
_OPENINGS = ("dict(", "{", "[", "(")
SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")
_SHARES = {"gamma", "gae_lambda", "tau", "exploration_fraction"}
_SHARES |= {"exploration_initial_eps", "exploration_final_eps"}
_POSITIVE = {"n_steps", "batch_size", "n_epochs", "buffer_size", "max_grad_norm", "clip_obs", "clip_reward"}
_POSITIVE |= {"epsilon", *SCHEDULED}


def read_entry(entry: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return an entry with plain values: no expressions, and ``normalize`` as a mapping or None.

    Read are ``dict(...)``, lists and mappings of literals, and activations such as ``nn.ReLU``.

    Args:
        entry: the hyper-parameters of an id, from YAML.

    Returns:
        The values that can be read, and a line for each of the others.
    """
    values: dict[str, Any] = {}
    problems = []
    for key, value in entry.items():
        try:
            values[key] = _plain(value, is_expression=key in ("normalize", "policy_kwargs"))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            what = one_line(error) if isinstance(error, UserError) else "is no expression of literals"
            problems.append(f"{key}: {what}")
    if isinstance(values.get("normalize"), bool):
        values["normalize"] = {} if values["normalize"] else None
    for key in ("n_envs", "n_timesteps", "frame_stack"):
        if key in values:
            values[key] = _whole(values[key])
    return values, problems


def _plain(value: Any, is_expression: bool = False) -> Any:
    """Return a value with its expressions read, those inside mappings and lists, too."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, str) and (is_expression or value.lstrip().startswith(_OPENINGS)):
        if len(value) > _LONGEST:
            raise UserError(f"is longer than {_LONGEST:,} characters")
        return _literal(ast.parse(value.strip(), mode="eval").body)
    return value


def _literal(node: ast.expr) -> Any:
    """Return what a tree of literals stands for; activations by their names."""
    match node:
        case ast.Constant(value=str() | int() | float() | None as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_literal(part) for part in parts]
        case ast.Dict(keys=keys, values=values) if all(isinstance(key, ast.Constant) for key in keys):
            return {key.value: _literal(value) for key, value in zip(keys, values, strict=True)}  # type: ignore[union-attr]
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=words) if all(word.arg for word in words):
            return {word.arg: _literal(word.value) for word in words}
        case ast.Attribute(value=ast.Name(id="nn") | ast.Attribute(attr="nn"), attr=name):
            return name
    raise UserError(
        f"{shown(ast.unparse(node))} is no literal, dict(...) or activation such as nn.ReLU; write it as "
        "YAML, a class as package.module:Class"
    )


def _whole(value: Any) -> Any:
    """Return a whole float as an integer, as 1e6; anything else unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def whole_arguments(values: Mapping[str, Any], function: Callable[..., Any]) -> dict[str, Any]:
    """Return arguments of a function, whole floats as integers where it takes integers."""
    arguments = inspect.signature(function).parameters
    integers = {
        name for name in values.keys() & arguments.keys() if _takes_only_integers(arguments[name].annotation)
    }
    return {name: _whole(value) if name in integers else value for name, value in values.items()}


def _takes_only_integers(annotation: object) -> bool:
    return "int" in str(annotation) and "float" not in str(annotation)


def argument_problems(
    values: Mapping[str, Any], function: Callable[..., Any], reserved: Collection[str]
) -> list[str]:
    """Return a line for each value that is no argument of a function, of the wrong type, or out of range."""
    arguments = inspect.signature(function).parameters
    known = set(arguments) - {"self", *reserved}
    takes_any = any(argument.kind == argument.VAR_KEYWORD for argument in arguments.values())
    unknown = [name for name in values if name not in known and (name in reserved or not takes_any)]
    hint = nearest if len(unknown) == 1 else meant
    problems = [f"unknown key {name!r}{hint(str(name), known)}" for name in unknown]
    found = {name: _problem(value, arguments[name]) for name, value in values.items() if name in known}
    return problems + [f"{name}: {problem}" for name, problem in found.items() if problem]


def _problem(value: Any, argument: inspect.Parameter) -> str | None:
    """Return what is wrong with an argument whose default is a number or a bool; None if nothing is."""
    default, name = argument.default, argument.name
    takes_text = "str" in str(argument.annotation) or name in SCHEDULED
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    expected = None
    if isinstance(default, bool):
        expected = None if isinstance(value, bool) else "true or false"
    elif isinstance(default, int | float) and not (takes_text and isinstance(value, str | list)):
        is_integer = argument.annotation in (int, "int")
        if not is_number or (is_integer and not isinstance(value, int)):
            expected = "a whole number" if is_integer else "a number (1.0e-4, not 1e-4)"
    if expected is None and is_number:
        if name in _SHARES and not 0 <= value <= 1:
            expected = "a number from 0 to 1"
        elif name in _POSITIVE and not value > 0:
            expected = "a number above 0"
    return None if expected is None else f"expected {expected}, got {shown(value)}"


def net_arch(value: Any, where: str) -> Any:
    """Return the sizes of layers: a list, or a mapping of lists such as ``pi`` and ``vf``.

    Raises:
        UserError: anything else; ``where`` begins the message.
    """
    if isinstance(value, Mapping):
        return {name: net_arch(sizes, f"{where}.{name}") for name, sizes in value.items()}
    if isinstance(value, list) and len(value) == 1 and isinstance(value[0], Mapping):
        return net_arch(value[0], where)  # as for Stable-Baselines3 before 1.8
    sizes = [_whole(size) for size in value] if isinstance(value, list) else [None]
    if not all(isinstance(size, int) and not isinstance(size, bool) and size > 0 for size in sizes):
        raise UserError(
            f"{where}: expected sizes of layers such as [64, 64], or a mapping of these, got {shown(value)}"
        )
    return sizes
