"""Values as rl-zoo3's files write them: expressions of Python are read, but never evaluated."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Collection, Mapping
from typing import Any

from fpg_bench.common.errors import UserError, meant, nearest, one_line, shown

_LONGEST = 10_000  # characters of an expression
_OPENINGS = ("dict(", "{", "[", "(")
SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")
_SHARES = {"gamma", "gae_lambda", "tau", "expectile", "exploration_fraction"}
_SHARES |= {"exploration_initial_eps", "exploration_final_eps"}
_POSITIVE = {"n_steps", "batch_size", "n_epochs", "buffer_size", "max_grad_norm", "clip_obs", "clip_reward"}
_POSITIVE |= {"epsilon", "train_freq", "target_update_interval", "policy_delay", *SCHEDULED}
_AUTOMATIC = ("ent_coef", "target_entropy")
_AUTO = re.compile(r"auto(_\d+(\.\d*)?(e-?\d+)?)?")
_NATURAL = {"learning_starts", "noise_sd", "target_policy_noise", "target_noise_clip", "alpha", "beta"}
_SIZES = {"n_actions", "lstm_hidden_size", "n_lstm_layers", "n_quantiles", "n_critics"}
LARGEST = 1e30  # of others; optimizers multiply them in single precision
_MOST = 10**12  # of whole numbers
_WIDEST = 16_384  # neurons of a layer; two such layers have 270 million weights

Entry = dict[str, Any]  # hyper-parameters of an id, or some of them: arguments of any algorithm


def read_entry(entry: Mapping[str, object]) -> tuple[Entry, list[str]]:
    """Return an entry with plain values: no expressions, and ``normalize`` as a mapping or None.

    Read are ``dict(...)``, lists and mappings of literals, and activations such as ``nn.ReLU``.

    Args:
        entry: the hyper-parameters of an id, from YAML.

    Returns:
        The values that can be read, and a line for each of the others.
    """
    values: Entry = {}
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


def whole_arguments(values: Mapping[str, object], kind: type) -> Entry:
    """Return arguments of a class, whole floats as integers where it takes integers."""
    arguments, _ = _arguments(kind)
    integers = {
        name for name in values.keys() & arguments.keys() if _takes_only_integers(arguments[name].annotation)
    }
    return {name: _whole(value) if name in integers else value for name, value in values.items()}


def _arguments(kind: type) -> tuple[dict[str, inspect.Parameter], bool]:
    """Return the arguments of a class, with those that it hands on to its bases; and if it hands on any."""
    arguments: dict[str, inspect.Parameter] = {}
    hands_on = None
    for base in (base for base in kind.__mro__ if "__init__" in vars(base)):
        own = inspect.signature(vars(base)["__init__"]).parameters.values()
        named = (each for each in own if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD))
        arguments = {each.name: each for each in named} | arguments
        takes_any = any(each.kind == each.VAR_KEYWORD for each in own)
        hands_on = takes_any if hands_on is None else hands_on
        if not takes_any:
            break
    return arguments, bool(hands_on)


def _takes_only_integers(annotation: object) -> bool:
    return "int" in str(annotation) and "float" not in str(annotation)


def argument_problems(
    values: Mapping[str, object], kind: type, reserved: Collection[str], is_custom: bool = False
) -> list[str]:
    """Return a line for each value that is no argument of a class, of the wrong type, or out of range.

    Args:
        values: the arguments.
        kind: the class.
        reserved: arguments that are not the user's.
        is_custom: a class of the user's, which with ``**options`` may take more than it names.
    """
    arguments, hands_on = _arguments(kind)
    known = set(arguments) - {"self", *reserved}
    takes_any = is_custom and hands_on
    unknown = [name for name in values if name not in known and (name in reserved or not takes_any)]
    hint = nearest if len(unknown) == 1 else meant
    problems = [f"unknown key {name!r}{hint(str(name), known)}" for name in unknown]
    found = {name: _problem(value, arguments[name]) for name, value in values.items() if name in known}
    return problems + [f"{name}: {problem}" for name, problem in found.items() if problem]


def _problem(value: Any, argument: inspect.Parameter) -> str | None:
    """Return what is wrong with an argument that is a number or a bool; None if nothing is."""
    default, name, kinds = argument.default, argument.name, str(argument.annotation)
    is_bool = isinstance(default, bool) or (default is None and "bool" in kinds and value is not None)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    expected = None
    if is_bool:
        expected = None if isinstance(value, bool) else "true or false"
    elif name == "replay_buffer_class":
        if value is not None and (not isinstance(value, type) or value.__name__ == "HerReplayBuffer"):
            expected = "null, or a class from Python; hindsight (HER) needs goals, which the game lacks"
    elif isinstance(default, type) and name != "activation_fn":  # of which torch has a list
        expected = None if isinstance(value, type | str) else "package.module:Class"
    elif name in _AUTOMATIC and isinstance(default, str):
        if not (is_number or (isinstance(value, str) and _AUTO.fullmatch(value))):
            expected = "a number, auto, or auto_<number>"
    elif isinstance(default, int | float) and not _is_special(value, name, kinds):
        is_integer = _takes_only_integers(argument.annotation)
        if not is_number or (is_integer and not isinstance(value, int)):
            expected = "a whole number" if is_integer else "a number (1.0e-4, not 1e-4)"
    if expected is None and is_number:
        if name in _SHARES and not 0 <= value <= 1:
            expected = "a number from 0 to 1"
        elif name in _POSITIVE and not value > 0:
            expected = "a number above 0"
        elif name in _SIZES and not 0 < value <= _WIDEST:
            expected = f"a whole number from 1 to {_WIDEST:,}"
        elif name in _NATURAL and value < 0:
            expected = "a number, 0 or more"
        elif name == "gradient_steps" and not (value > 0 or value == -1):
            expected = "a whole number above 0, or -1 for as many as steps"
        elif not abs(value) <= (most := _MOST if isinstance(value, int) else LARGEST):  # NaN is not, either
            expected = f"a number up to {most:.0e}"
    return None if expected is None else f"expected {expected}, got {shown(value)}"


def _is_special(value: Any, name: str, kinds: str) -> bool:
    """Return True for a schedule as text, and for a frequency as ``[1, episode]``."""
    if isinstance(value, list) and len(value) == 2:
        count, unit = value
        return "tuple" in kinds and type(count) is int and count > 0 and unit in ("step", "episode")
    return isinstance(value, str) and name in SCHEDULED


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
    if not all(type(size) is int and 0 < size <= _WIDEST for size in sizes):
        raise UserError(
            f"{where}: expected sizes of layers such as [64, 64], up to {_WIDEST:,}, or a mapping of these, "
            f"got {shown(value)}"
        )
    return sizes
