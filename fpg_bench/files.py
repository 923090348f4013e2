"""Reading and writing files so that a bad one is a clear error and a good one is never half written."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.errors import UserError


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML's safe loader, which refuses a key that is written twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if key.tag != "tag:yaml.org,2002:merge"]
        for key in {key for key in keys if keys.count(key) > 1}:
            raise yaml.constructor.ConstructorError(
                None, None, f"the key {key!r} stands there twice", node.start_mark
            )
        return super().construct_mapping(node, deep)


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """The mapping in a YAML file, loaded safely.

    Raises:
        UserError: the file cannot be read, is not YAML, or holds no mapping; ``what`` begins the message.
    """
    try:
        content = _UniqueKeyLoader(_read(path, what)).get_single_data()
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"{what} {path}: not valid YAML: {' '.join(str(error).split())}") from error
    return _mapping(content, path, what)


def read_json(path: Path, what: str) -> dict[str, Any]:
    """The object in a JSON file; raises as :func:`read_yaml` does."""
    text = _read(path, what)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{what} {path}: not valid JSON: {error}") from error
    return _mapping(content, path, what)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name and rename it, so that it is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def write_json(path: Path, content: Any) -> None:
    """Write ``content`` as indented JSON, whole."""
    write_whole(path, json.dumps(content, indent=2) + "\n")


def _read(path: Path, what: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UserError(f"{what} {path}: cannot be read: {reason}") from error


def _mapping(content: Any, path: Path, what: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise UserError(f"{what} {path}: expected a mapping, got {type(content).__name__}")
    return content
