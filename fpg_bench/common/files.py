"""Reading and writing of files: bad content is a clear error, and no file is left half written."""

from __future__ import annotations

import contextlib
import errno
import functools
import glob
import gzip
import io
import json
import logging
import os
import re
import shutil
import socket
import stat
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import platformdirs
import yaml
from yaml.composer import Composer

from fpg_bench.common.errors import UserError, one_line, other_content, shown
from fpg_bench.common.strict_json import LONGEST, JsonObject, read_plain

PACKED = ".gz"
os.umask(_UMASK := os.umask(0o077))  # there is no other way to read it
_MOST_NODES = 100_000
_MOST_YAML = 200_000  # bytes; without libyaml 60,000 are read a second; the largest file shipped has 25,000
_DEEPEST = 50
_MOST_UNPACKED = 2**28  # bytes of a packed zip; models and buffers are stored as they are
_MOST_BITS = 1024  # of a whole number
_BRACKET = re.compile(r"[\[\]{}]")
if TYPE_CHECKING:
    from yaml import SafeLoader as Loader
else:
    Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _CarefulLoader(Loader, Composer):
    """YAML's safe loader, which also refuses duplicate keys and aliases that expand without bound.

    Events are libyaml's where PyYAML has it, nodes are not: its own composer overflows the stack.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        Composer.__init__(self)

    def get_single_node(self) -> yaml.Node | None:
        node = Composer.get_single_node(self)
        if node is not None and _expanded(node, {}) > _MOST_NODES:
            raise yaml.constructor.ConstructorError(
                None, None, f"its aliases stand for more than {_MOST_NODES:,} values", node.start_mark
            )
        return node

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) <= _MOST_BITS:  # Python refuses to read 4,300 digits and more
            number: int = super().construct_yaml_int(node)
            if number.bit_length() <= _MOST_BITS:  # no text and no float can show a larger one
                return number
        raise yaml.constructor.ConstructorError(None, None, "a number is too large", node.start_mark)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        written = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        merges = {key.value for key, _ in node.value if key.tag == "tag:yaml.org,2002:merge"}
        for key in (key for key, times in written.items() if times > 1 and key not in merges):
            raise yaml.constructor.ConstructorError(
                None, None, f"the key {key!r} stands there twice", node.start_mark
            )
        return super().construct_mapping(node, deep)


def _ordered(loader: _CarefulLoader, node: yaml.SequenceNode) -> dict[Any, Any]:
    """Return an ``OrderedDict`` that PyYAML wrote: an argument, which is a list of pairs."""
    (pairs,) = loader.construct_sequence(node, deep=True)
    if len(written := dict(pairs)) < len(pairs):
        raise yaml.constructor.ConstructorError(None, None, "a key stands there twice", node.start_mark)
    return written


def _listed(loader: _CarefulLoader, node: yaml.SequenceNode) -> list[Any]:
    return loader.construct_sequence(node, deep=True)


_CarefulLoader.add_constructor("tag:yaml.org,2002:int", _CarefulLoader.construct_yaml_int)
# As rl-zoo3 writes the configuration of a run; neither makes an object.
_CarefulLoader.add_constructor("tag:yaml.org,2002:python/object/apply:collections.OrderedDict", _ordered)
_CarefulLoader.add_constructor("tag:yaml.org,2002:python/tuple", _listed)


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """Return the number of values that a node stands for once its aliases are expanded."""
    if id(node) not in known:
        known[id(node)] = _MOST_NODES + 1  # inside itself it would be endless
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        flat = chain.from_iterable(parts) if isinstance(node, yaml.MappingNode) else parts
        known[id(node)] = 1 + sum(_expanded(part, known) for part in flat)
    return known[id(node)]


def read_yaml(path: Path, what: str) -> JsonObject:
    """Return the mapping in a YAML file, loaded safely.

    Raises:
        UserError: the file cannot be read, is not YAML, or holds no mapping; ``what`` begins the message.
    """
    text = _read(path, what, _MOST_YAML)
    if _too_deep(text):  # the parser's time grows with the square of the depth
        raise UserError(f"{what} {path}: not valid YAML: more than {_DEEPEST} brackets within brackets")
    try:
        content = _CarefulLoader(text).get_single_data()
    except Exception as error:  # PyYAML lets errors of many kinds out, tagged values above all
        raise UserError(f"{what} {path}: not valid YAML: {one_line(error)}") from error
    return _mapping(content, path, what)


def _too_deep(text: str) -> bool:
    """Return True if brackets are nested too deeply, quoted ones included."""
    depth = 0
    for bracket in _BRACKET.finditer(text):
        depth = depth + 1 if bracket[0] in "[{" else max(depth - 1, 0)
        if depth > _DEEPEST:
            return True
    return False


def read_json(path: Path, what: str) -> JsonObject:
    """Return the object in a JSON file; raises as :func:`read_yaml` does."""
    text = _read(path, what, LONGEST)
    try:
        content = read_plain(text, nan=True)
    except ValueError as error:
        raise UserError(f"{what} {path}: not valid JSON: {error}") from error
    return _mapping(content, path, what)


def read_bounded(path: Path, what: str, most: int) -> bytes:
    """Return the bytes of a file, unpacked if its name ends in ``.gz``, and never more than ``most``.

    Raises:
        UserError: it can't be read or unpacked, is longer, or is no regular file (a pipe may never end);
            ``what`` begins the message.
    """
    try:
        check_regular(path)
        with gzip.open(path) if path.suffix == PACKED else path.open("rb") as file:
            data: bytes = file.read(most + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise UserError(f"{what} {path}: cannot be unpacked: {error}") from error
    except OSError as error:
        raise UserError(f"{what} {path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # with a null character, or half a letter
        raise UserError(f"{what} {path}: cannot be read: is no name of a file") from error
    if len(data) > most:
        raise UserError(
            f"{what} {path}: is longer than {most:,} bytes{', unpacked' * (path.suffix == PACKED)}"
        )
    return data


def check_regular(path: Path) -> None:
    """Raise OSError for anything but a regular file, before a reader waits at a pipe for ever."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "is not a regular file", str(path))


def check_unpacked(path: Path, inner: str = "") -> None:
    """Raise OSError for a zip that unpacks to far more than it holds, or is no regular file.

    Args:
        path: the zip.
        inner: ending of names in it that are zips, too; "": there are none.
    """
    check_regular(path)
    with zipfile.ZipFile(path) as archive:
        parts = archive.infolist()
        for name in (part.filename for part in parts if inner and part.filename.endswith(inner)):
            parts = parts + zipfile.ZipFile(archive.open(name)).infolist()
    if (size := sum(part.file_size for part in parts)) > max(2 * path.stat().st_size, _MOST_UNPACKED):
        raise OSError(errno.EFBIG, f"unpacks to {size:,} bytes", str(path))


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically: under a temporary name, which is then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode() if isinstance(content, str) else content
    _sweep(path)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f"{_begun(path)}{os.getpid()}-")
    except OSError as error:  # in a folder of somebody else's
        error.filename = str(path)
        raise
    try:
        with naming(path):
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            os.chmod(temporary, 0o666 & ~_UMASK)  # mkstemp does not ask it
            os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Within the context, let errors of files that name none, such as those of a full disk, name a path."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise


@contextlib.contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside a path, whose content is renamed to it once it is whole.

    What processes left there that were killed is removed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep(path)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f"{_begun(path)}{os.getpid()}-") as folder:
        yield Path(folder)


def as_path(value: Any, where: str) -> Path:
    """Return what names a file or folder as a path; raise UserError for what can be no name of one."""
    try:
        with contextlib.suppress(OSError):
            os.lstat(path := Path(value))
    except (TypeError, ValueError):  # with a null character, or half a letter
        raise UserError(f"{where}: expected a path, got {shown(value)}") from None
    return path


def check_own_folder(folder: Path, description: str, what: str) -> None:
    """Raise UserError for a foreign folder: it has files, but not the one that describes its content.

    Args:
        folder: the folder, which need not exist.
        description: name of the file that is written first.
        what: what the folder would hold, in messages.
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file; choose a folder")
    names = os.listdir(folder) if folder.exists() else []
    begun = f".{description}."  # of a process that writes the description, or was killed while it did
    if description not in names and not all(name.startswith(begun) for name in names):
        raise other_content(folder, f"other files, but no {what}")


def check_writable(folder: Path) -> None:
    """Raise UserError for a folder that cannot be written to, or cannot be made."""
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise UserError(f"out: {there} is a file; name a folder")
    if not os.access(there, os.W_OK):
        raise UserError(f"out: {there} cannot be written to; make it writable, or name another")


def check_target(file: Path, what: str = "out") -> None:
    """Raise UserError for a file that cannot be written; nothing is made, its folder neither.

    A folder of results is made where it is missing; one file in a folder that is not there is a slip.
    """
    folder = file.absolute().parent
    if os.path.isdir(file):
        raise UserError(f"{what}: {file} is a folder; name a file")
    if not os.path.isdir(folder):
        raise UserError(f"{what}: {file}: there is no folder {folder}; make it first, or name another")
    try:
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        raise UserError(f"{what}: {file} cannot be written: {error.strerror}") from error


def _begun(path: Path) -> str:
    """Return the prefix of this machine's temporary files for a path."""
    return f".{path.name}.{socket.gethostname()}-"


def _sweep(path: Path) -> None:
    """Remove temporary files and folders of processes that were killed while they wrote a path."""
    for left in path.parent.glob(f"{glob.escape(_begun(path))}*"):
        pid = left.name.removeprefix(_begun(path)).partition("-")[0]
        if pid.isdecimal() and not _alive(int(pid)):
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def write_json(path: Path, content: object) -> None:
    """Write ``content`` as indented JSON, atomically."""
    write_whole(path, json.dumps(content, indent=2) + "\n")


def _read(path: Path, what: str, most: int) -> str:
    try:
        return io.TextIOWrapper(io.BytesIO(read_bounded(path, what, most)), "utf-8").read()
    except UnicodeDecodeError as error:
        raise UserError(f"{what} {path}: cannot be read: {error}") from error


def _mapping(content: object, path: Path, what: str) -> JsonObject:
    if content is None:
        raise UserError(f"{what} {path}: is empty")
    if not isinstance(content, dict):
        raise UserError(f"{what} {path}: expected a mapping, got {type(content).__name__}")
    return content


def user_cache() -> Path:
    """Return the user's cache folder; without a home folder, a private one among the temporary files."""
    try:
        folder = platformdirs.user_cache_path("fpg_bench")
        if folder.is_absolute():
            return folder
    except RuntimeError:  # no HOME, and no entry in the password file
        pass
    return _own_temporary_folder()


@functools.cache
def _own_temporary_folder() -> Path:
    """Return a folder that no other user can write, and say so once: what lies in a cache is run."""
    folder = _made_temporary_folder()
    logging.getLogger(__name__).warning(f"no home folder (set HOME); the cache is {folder}")
    return folder


def _made_temporary_folder() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else ""
    folder = Path(tempfile.gettempdir()) / f"fpg_bench-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
        if user == "" or (about.st_uid == user and about.st_mode & 0o170077 == 0o040000):
            return folder
    except OSError:  # a file, or another's
        pass
    return Path(tempfile.mkdtemp(prefix="fpg_bench-"))
