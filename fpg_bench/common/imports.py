"""Import of objects from the user's own code, named ``package.module:object``.

A name that a user types or gives in Python is imported. A name that comes out of a file is imported only if
the user allows it: every reader of such files calls :func:`check_allowed`.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib
import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError

HUB = "hf://"  # begins the name of an agent on the Hugging Face Hub
SUITE = "suite:"  # begins the name of a suite's members
_WEIGHTED = re.compile(r"(.+)\*(\d{1,9})", re.ASCII | re.DOTALL)  # a player and its weight
_OWN = ("fpg_bench.training.waterfall_cnn:WaterfallCNN",)  # code of the package that files may name


def names_object(name: str) -> bool:
    """Return True for ``package.module:object``; not for a path that begins with a drive of Windows."""
    return ":" in name and not re.match(r"[A-Za-z]:[\\/]", name)


def import_object(name: str, what: str, methods: Sequence[str], scenario: object) -> Any:
    """Return the object that ``package.module:object`` names; the current folder is searched, too.

    A class or function is called first, with the scenario if it takes an argument.

    Args:
        name: ``package.module:object``.
        what: what it should be; begins the message of an error.
        methods: it must have one of these.
        scenario: what is played.

    Raises:
        UserError: no such module or object, one that fails, or one without any of the methods.
    """
    return ready(imported(name, what), f"{what} {name!r}", methods, scenario)


def check_allowed(content: object, allow: Collection[str], where: str) -> None:
    """Refuse the code and the agents of the Hub that the content of a file names, but those that are allowed.

    Args:
        content: text, or mappings and lists with texts in them.
        allow: the names that the user trusts.
        where: names the file; begins the message.

    Raises:
        UserError: the content names code (``package.module:object``) or an agent of the Hub that is not
            allowed.
    """
    for text in code_named(content):
        if text not in allow:
            raise UserError(f"{where}: would run {text}; if you trust it, add --allow {text}")


def code_named(content: object) -> list[str]:
    """Return the code (``package.module:object``) and the agents of the Hub that a content names."""
    texts = (split_weight(text)[0] for text in _texts(content))
    return [text for text in texts if (is_code(text) or text.startswith(HUB)) and text not in _OWN]


def split_weight(name: str) -> tuple[str, int]:
    """Return a player's name and its weight in a population: ``tone`` and 8 of ``tone*8``; without one, 1."""
    match = _WEIGHTED.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, 1)


def is_code(name: str) -> bool:
    """Return True if a name is of the form ``package.module:object``, the only one that is ever imported."""
    module, _, attribute = name.partition(":")
    return all(module.split(".")) and attribute.isidentifier() and not name.startswith(SUITE)


def _texts(content: object) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping):
        yield from _texts([*content, *content.values()])
    elif isinstance(content, list | tuple):
        for each in content:
            yield from _texts(each)


def imported(name: str, what: str) -> Any:
    """Return what ``package.module:object`` names, as it is; the current folder is searched, too.

    Raises:
        UserError: no such module or object, or a module that fails; ``what`` begins the message.
    """
    if not is_code(name):
        raise UserError(f"{what} {name!r}: expected package.module:object")
    module, _, attribute = name.partition(":")
    _search_here()
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UserError(f"{what} {name!r}: {error}") from error
    except Exception as error:  # a module is anybody's code
        raise UserError(f"{what} {name!r}: importing it failed: {reason(error)}") from error


def code_fingerprint(name: str) -> str:
    """Return the hash of the source of ``package.module:object``; the name if there is none.

    It covers all modules of the package, and of the user's own packages and modules that these import; not
    what the code reads from other files, nor modules that it imports by computed names. Nothing is run.
    """
    if not is_code(name):
        return name
    _search_here()
    first = name.partition(":")[0].partition(".")[0]
    digest, todo, known = hashlib.sha256(name.encode()), [first], {first}
    while todo:
        module = todo.pop()
        for path in _sources(module, is_named=module == first):
            source = path.read_bytes()
            digest.update(f"\0{module}/{path.name}\0".encode() + source)
            todo += sorted(_imports(source) - known)
            known |= _imports(source)
    return digest.hexdigest()


@functools.lru_cache(maxsize=1024)
def _imports(source: bytes) -> frozenset[str]:
    """Return the first parts of the names of packages and modules that a source imports by statements."""
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError, RecursionError):
        return frozenset()
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    return frozenset(name.partition(".")[0] for name in names)


def _sources(module: str, is_named: bool) -> list[Path]:
    """Return the source files of a module or package, in order; one that is not named must be the user's."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):  # ``__main__``, for one
        return []
    places = [] if spec is None else map(Path, spec.submodule_search_locations or [spec.origin or ""])
    own = [place for place in places if is_named or not _is_foreign(place)]
    files = [file for place in own for file in (place.rglob("*.py") if place.is_dir() else [place])]
    return sorted(file for file in files if file.suffix == ".py" and file.is_file())


def _search_here() -> None:
    """Let modules of the current folder be found."""
    if "" not in sys.path:
        sys.path.insert(0, "")


def _is_foreign(file: Path) -> bool:
    """Return True if a file is part of this package, of Python, or of what is installed beside it."""
    others = (Path(__file__).parents[1], Path(sys.prefix), Path(sys.base_prefix))
    is_installed = not {"site-packages", "dist-packages"}.isdisjoint(file.parts)
    return is_installed or any(file.absolute().is_relative_to(folder) for folder in others)


def ready(thing: object, what: str, methods: Sequence[str], scenario: object) -> Any:
    """Return an object with one of the methods: the given one, or what it makes if it is a class or function.

    Raises:
        UserError: making it fails, or it has none of the methods; ``what`` begins the message.
    """
    if callable(thing) and (isinstance(thing, type) or not has_any(thing, methods)):
        thing = _made(thing, what, scenario)
    if not has_any(thing, methods):
        raise UserError(f"{what}: has no {' or '.join(methods)}")
    return thing


def has_any(thing: object, methods: Sequence[str]) -> bool:
    """Return True if an object has at least one of the methods."""
    return any(callable(getattr(thing, method, None)) for method in methods)


def reason(error: Exception) -> str:
    """Return the type and message of an exception in one line, and where the user's own code raised it."""
    return " ".join(f"{type(error).__name__}: {error}{_at_line(error)}".split())


def described(error: Exception) -> str:
    """Return one line on an exception that nobody caught: a fault of the user's code, or a bug of ours."""
    return f"{'' if _at_line(error) else 'a bug: '}{reason(error)}"


def _at_line(error: BaseException) -> str:
    """Return ``, in FILE, line N`` where an exception arose in the user's own code; empty if it did not."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if file.is_file() and not _is_foreign(file):
            return f", in {frame.filename}, line {frame.lineno}"
    return ""


def _made(maker: Callable[..., Any], what: str, scenario: object) -> Any:
    """Call a class or function, with the scenario if it takes an argument."""
    try:
        return maker(scenario) if inspect.signature(maker).parameters else maker()
    except UserError:
        raise
    except Exception as error:  # so is a class
        raise UserError(f"{what}: making it failed: {reason(error)}") from error
