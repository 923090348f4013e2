"""Name the committed files that are stale, and the commands that make them again.

python scripts/lineage.py                    compares all stages of lineage.yml with lineage.lock
python scripts/lineage.py --made STAGE ...   records stages as they are now, after their commands ran

``lineage.lock`` holds a hash of everything that a stage is made from, and of what it makes. A stage is stale
once one of them differs. What cannot change a result is no part of a hash: the comments and docstrings of
Python, and the comments, order and layout of YAML and JSON.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import io
import json
import sys
import tokenize
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BeforeValidator, Field

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.schema import Items, Strict, parse

ROOT = Path(__file__).parents[1]
STAGES, LOCK = "lineage.yml", "lineage.lock"
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# Reasons to be stale. What is made from something new may have been made again, too, without being recorded.
_REASONS = {"from": "made from what has changed", "makes": "changed by something else than its command"}
Hashes = dict[str, dict[str, str]]  # of a stage, by "from" and "makes", and by the pattern


def _flat(patterns: Any) -> Any:
    """Return a list without lists in it, as YAML's anchors leave them."""
    if not isinstance(patterns, list):
        return patterns
    return [one for each in patterns for one in (_flat(each) if isinstance(each, list) else [each])]


class Stage(Strict):
    """Committed files that one command makes.

    Attributes:
        by: the command; "read" and pages, where nothing writes the figures that a page's prose quotes.
        makes: the files.
        made_from: what it is made from, ``from`` in the file.
        revision: the revision that has the command or all that it needs, where they are gone.
        waits: why it stays although it is stale; such a stage is named, but no error.
        note: a remark.
    """

    by: str
    makes: Items[str] = ()
    made_from: Annotated[Items[str], BeforeValidator(_flat), Field(alias="from")] = ()
    revision: str | None = None
    waits: str = ""
    note: str = ""


def load_stages(root: Path = ROOT) -> dict[str, Stage]:
    """Return the stages by their names; raises UserError for a file that is not as described."""
    stages = read_yaml(root / STAGES, "stages").get("stages")
    return parse(dict[str, Stage], stages, STAGES)


def files_of(pattern: str, root: Path = ROOT) -> list[Path]:
    """Return the files of a pattern, sorted.

    Args:
        pattern: a path with ``*`` and ``**``, a folder's for all in it; then perhaps ``#`` and a part's name.
        root: folder that paths begin at.

    Raises:
        UserError: there are none.
    """
    found = root.glob(pattern.partition("#")[0])
    files = {file for path in found for file in (path.rglob("*") if path.is_dir() else [path])}
    files = sorted(file for file in files if file.is_file() and "__pycache__" not in file.parts)
    if not files:
        raise UserError(f"{STAGES}: no file {pattern!r}")
    return files


def hash_of(pattern: str, root: Path = ROOT) -> str:
    """Return the hash of the files of a pattern, or of a part of each.

    A part is ``#levers`` of a page: what stands between ``<!-- levers -->`` and ``<!-- end -->``;
    ``#groups.*.steps`` of YAML and JSON: the values of these keys; ``#GOLDEN.link`` of Python: the
    expression that is assigned to a name, or its value for a key.

    Raises:
        UserError: there are no such files, or no such part.
    """
    part, digest = pattern.partition("#")[2], hashlib.sha256()
    for path in files_of(pattern, root):
        try:
            content = _content(path, part)
        except (LookupError, ValueError, SyntaxError) as error:
            raise UserError(f"{STAGES}: {path}: no part {part!r}: {error}") from error
        digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]


def _content(path: Path, part: str) -> bytes:
    """Return what can change a result in a file, or in a part of it."""
    data = path.read_bytes()
    if path.suffix in (".yml", ".yaml", ".json"):
        values = json.loads(data) if path.suffix == ".json" else yaml.load(data, _LOADER)
        found = list(_values(values, part.split(".") if part else []))
        if not found:
            raise LookupError("no such key")
        return json.dumps(found, sort_keys=True, default=str).encode()
    if path.suffix == ".py":
        return (_assigned(data.decode(), *part.split(".")) if part else _code(data.decode())).encode()
    if not part:
        return data
    inside, end, _ = data.partition(f"<!-- {part} -->".encode())[2].partition(b"<!-- end -->")
    if not end:
        raise LookupError("no such marks")
    return inside


def _values(data: Any, path: list[str]) -> Iterator[Any]:
    """Yield the values at a path of keys, with the keys that a ``*`` stands for."""
    if not path:
        yield data
    elif isinstance(data, dict):
        for key, value in data.items():
            if fnmatchcase(str(key), path[0]):
                yield from ([key, each] for each in _values(value, path[1:]))


def _assigned(text: str, name: str, key: str | None = None) -> str:
    """Return the source of the expression that Python code assigns to a name, or of its value for a key."""
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            value = node.value
            if key is not None and isinstance(value, ast.Dict):
                keys = [ast.literal_eval(each) for each in value.keys if each]
                value = value.values[keys.index(key)]
            return ast.get_source_segment(text, value) or ""
    raise LookupError("no such name")


def _code(text: str) -> str:
    """Return the lines of Python code without comments and docstrings."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            lines[token.start[0] - 1] = token.line[: token.start[1]]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            first, last = node.body[0].lineno, node.body[0].end_lineno
            lines[first - 1 : last] = [""] * (last - first + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def fill(path: Path, parts: Mapping[str, str]) -> None:
    """Put texts between the marks of a page, ``<!-- title -->`` and ``<!-- end -->``.

    Marks on one line hold a few words in the midst of a sentence; others have lines of their own.

    Raises:
        UserError: the page lacks a mark; nothing is written then.
    """
    try:
        write_whole(path, filled(path.read_text(encoding="utf-8"), parts))
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def filled(page: str, parts: Mapping[str, str]) -> str:
    """Return the text of a page with texts between its marks; raises UserError if it lacks a mark."""
    for title, text in parts.items():
        head, mark, rest = page.partition(f"<!-- {title} -->")
        inside, end, rest = rest.partition("<!-- end -->")
        if not (mark and end):
            raise UserError(f"there are no marks {title!r}")
        around = "\n\n" if "\n" in inside else ""
        page = f"{head}{mark}{around}{text.strip()}{around}{end}{rest}"
    return page


def hashes_of(stage: Stage, root: Path = ROOT) -> Hashes:
    """Return the hashes of a stage as its files are."""
    patterns = {"from": stage.made_from, "makes": stage.makes}
    return {kind: {each: hash_of(each, root) for each in sorted(of)} for kind, of in patterns.items()}


def read_lock(root: Path = ROOT) -> dict[str, Hashes]:
    """Return the hashes of all stages as they were made."""
    file = root / LOCK
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def reasons(now: Hashes, made: Hashes | None) -> list[str]:
    """Return why a stage is stale, in one text; none if it is not."""
    if made is None:
        return ["never recorded"]
    for kind, text in _REASONS.items():
        names = now[kind] | made[kind]
        if changed := [each for each in names if now[kind].get(each) != made[kind].get(each)]:
            return [f"{text}: {', '.join(changed)}"]
    return []


def check(root: Path = ROOT) -> tuple[dict[str, str], dict[str, str]]:
    """Return the stale stages, and those of them that wait, with a text each: why, and the command."""
    stages, made = load_stages(root), read_lock(root)
    stale, waiting = dict.fromkeys(made.keys() - stages.keys(), f"in {LOCK}, but not in {STAGES}"), {}
    for name, stage in stages.items():
        try:
            found = reasons(hashes_of(stage, root), made.get(name))
        except UserError as error:
            found = [str(error)]
        where = f" (at revision {stage.revision})" if stage.revision else ""
        text = "\n  ".join([*found, f"made by{where}: {stage.by}"])
        if found and stage.waits:
            waiting[name] = f"{text}\n  waits: {stage.waits}"
        elif found:
            stale[name] = text
        elif stage.waits:
            stale[name] = "is not stale, so it waits for nothing: remove the key"
    return stale, waiting


def record(names: list[str], root: Path = ROOT) -> None:
    """Write the hashes of these stages as they are now; those of stages that are gone are dropped."""
    stages, made = load_stages(root), read_lock(root)
    for name in names:
        if name not in stages:
            raise UserError(f"no stage {name!r} in {STAGES}{nearest(name, stages)}")
        made[name] = hashes_of(stages[name], root)
    content = {name: made[name] for name in stages if name in made}
    write_whole(root / LOCK, json.dumps(content, indent=1) + "\n")


def main(root: Path = ROOT) -> int:
    """Check or record stages; returns 1 if one is stale and does not wait."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--made", nargs="*", metavar="STAGE", help="record these, and drop those that are gone"
    )
    if (names := parser.parse_args().made) is not None:
        record(names, root)
    stale, waiting = check(root)
    for name, text in (waiting | stale).items():
        print(f"{name}: {text}")
    print(f"{len(load_stages(root))} stages, {len(stale)} stale, {len(waiting)} that wait")
    if stale:
        print("Run the commands, then: python scripts/lineage.py --made STAGE ...")
    return int(bool(stale))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"lineage: {error}")
