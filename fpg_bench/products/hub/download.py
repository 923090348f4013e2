"""Agents on the Hugging Face Hub: their names, ``hf://owner/name@revision``, and their download.

Only ``agent.json`` and ``policy.onnx`` are downloaded, and both are data. They are received into memory, with
bounds and one deadline, and kept under names that no server chooses. The client library ``huggingface_hub``
(extra ``hub``) finds the Hub, connects to it and uploads; the token comes from ``HF_TOKEN`` alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import hashlib
import logging
import os
import re
import threading
from collections.abc import Coroutine, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

from fpg_bench.common.errors import UserError, first_line, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import write_whole
from fpg_bench.common.imports import HUB
from fpg_bench.common.strict_json import read_object
from fpg_bench.products.sandbox.client import AGENT_FILES
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from huggingface_hub import HfApi

EVAL_RESULTS = ".eval_results/fpg-bench.yaml"  # where the Hub looks for scores
PUSHED_FILES = (
    *(*AGENT_FILES, "README.md", "replay.html", "curve.png", "records.jsonl"),
    *(EVAL_RESULTS, ".gitattributes"),
)
_NAME = re.compile(rf"{HUB}([\w.-]+/[\w.-]+)(?:@(\S+))?")
_COMMIT = re.compile(r"[0-9a-f]{40}")
TIMEOUT_S = 10  # of the first request of an upload
DEADLINE_S = 60  # of a download, from the first request to the last byte
LONGEST_LISTING = 1_000_000  # bytes of the list of a repository's files
_SHORTEST_SECRET = 8
_MOST_NAMED = 3  # of ignored files
_logger = logging.getLogger(__name__)
Spec = TypeVar("Spec")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Snapshot:
    """An agent of one commit of a repository, downloaded.

    Attributes:
        repository: ``owner/name``.
        revision: the branch, tag or commit that was asked for.
        commit: the commit that the revision stands for, 40 hexadecimal digits.
        folder: the folder of its files in the cache.
    """

    repository: str
    revision: str
    commit: str
    folder: Path

    @property
    def name(self) -> str:
        """Name of the player that never changes."""
        return f"{HUB}{self.repository}@{self.commit}"


def hub_name(repository: str, revision: str | None = None) -> str:
    """Return the player's name of ``owner/name`` at a revision; such a name is accepted, too.

    Raises:
        UserError: not of this form, or two revisions.
    """
    name = repository if repository.startswith(HUB) else HUB + repository
    if revision is not None:
        if "@" in name:
            raise UserError(f"{name}: names a revision, and so does --revision; give only one")
        name += f"@{revision}"
    split_name(name)
    return name


def split_name(name: str) -> tuple[str, str]:
    """Return the repository and the revision of a player's name; raises UserError for another form."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise UserError(f"{name!r}: expected owner/name or hf://owner/name, with @revision if you like")
    return match[1], match[2] or "main"


@functools.cache
def resolve(name: str) -> Snapshot:
    """Download an agent by its player's name; a name stands for one commit as long as the program runs.

    Raises:
        UserError: see :func:`download`.
    """
    snapshot = download(name)
    if snapshot.commit != snapshot.revision:
        _logger.info(f"{name} is commit {snapshot.commit}")
    return snapshot


def client() -> HfApi:
    """Return the Hub's client, with the token of ``HF_TOKEN`` or none.

    Raises:
        UserError: the extra ``hub`` is not installed, or the variable holds no token.
    """
    require_extra("hub", "huggingface_hub", "onnx")
    from huggingface_hub import HfApi

    token = os.environ.get("HF_TOKEN", "").strip()
    if not token.isascii() or not token.isprintable():
        raise UserError("HF_TOKEN: holds characters that no token has")
    return HfApi(token=token or False, library_name="fpg-bench", library_version=__version__)


def download(name: str) -> Snapshot:
    """Download the two files of an agent into the cache, where they may lie already.

    A commit that is there needs no network. A branch or tag is looked up each time; a warning says if it has
    moved since it was last downloaded.

    Args:
        name: ``hf://owner/name`` (its branch ``main``), or with ``@revision``: a branch, tag or commit.

    Raises:
        UserError: no such repository, revision or agent, no right to read it, a file that is too large, or a
            Hub that cannot be reached, does not end or answers otherwise than a Hub.
        OSError: the cache cannot be written.
    """
    repository, revision = split_name(name)
    api = client()
    token = api.token if isinstance(api.token, str) else None
    from huggingface_hub import constants
    from huggingface_hub.utils import validate_repo_id  # type: ignore[attr-defined]

    with hub_errors(name):
        validate_repo_id(repository)
        home = Path(constants.HF_HOME) / "fpg-bench" / repository.replace("/", "--")
        latest = home / f"revision-{hashlib.sha256(revision.encode()).hexdigest()[:16]}"
        is_commit = _COMMIT.fullmatch(revision) is not None
        if is_commit and all((home / revision / file).is_file() for file in AGENT_FILES):
            return Snapshot(repository, revision, revision, home / revision)
        commit, files = _finish(_receive(name, token), DEADLINE_S)
        for file, data in files.items():
            write_whole(home / commit / file, data)
    last = latest.read_text() if latest.is_file() else commit
    if last != commit:
        _logger.warning(
            f"{HUB}{repository}: {revision} has moved from commit {last:.40} to {commit} "
            "since it was last downloaded"
        )
    if not is_commit:
        write_whole(latest, commit)
    return Snapshot(repository, revision, commit, home / commit)


def _finish(work: Coroutine[Any, Any, _Result], deadline_s: float) -> _Result:
    """Run a coroutine in a thread, as a notebook's event loop may run in this one; raises what it raises."""
    done: list[_Result | BaseException] = []

    def run() -> None:
        try:
            done.append(asyncio.run(asyncio.wait_for(work, deadline_s)))
        except BaseException as error:  # handed over to the caller
            done.append(error)

    thread = threading.Thread(target=run, name="fpg-bench-hub", daemon=True)
    thread.start()
    thread.join()
    (result,) = done
    if isinstance(result, TimeoutError):
        raise ConnectionError(f"timed out after {deadline_s:g} s")
    if isinstance(result, BaseException):
        raise result
    return result


async def _receive(name: str, token: str | None) -> tuple[str, dict[str, bytes]]:
    """Return the commit of an agent's name, and its files; raises as :func:`download` does."""
    from huggingface_hub import constants, get_async_session

    repository, revision = split_name(name)
    api = f"{constants.ENDPOINT}/api/models/{repository}/revision/{quote(revision, safe='')}?blobs=true"
    async with get_async_session() as session:
        # Without the library's hook for responses, which reads the whole body of an error
        session.event_hooks = {"request": session.event_hooks["request"]}
        try:
            listing = read_object(
                await _get(session, name, "the list of its files", api, LONGEST_LISTING, token)
            )
            commit = listing["sha"]
            sizes = {each["rfilename"]: each.get("size") for each in listing.get("siblings") or ()}
            is_sound = all(
                isinstance(file, str) and type(size) in (int, type(None)) for file, size in sizes.items()
            )
            if not (isinstance(commit, str) and _COMMIT.fullmatch(commit) and is_sound):
                raise ValueError
        except UserError:
            raise
        except (ValueError, TypeError, KeyError, AttributeError):
            raise UserError(
                f"{name}: {constants.ENDPOINT} does not answer as a Hub does (HF_ENDPOINT)"
            ) from None
        if _COMMIT.fullmatch(revision) and commit != revision:
            raise UserError(f"{name}: {constants.ENDPOINT} answers with another commit, {commit}")
        _check_files(name, sizes)
        files = {}
        for file, most in AGENT_FILES.items():
            url = f"{constants.ENDPOINT}/{repository}/resolve/{commit}/{file}"
            files[file] = data = await _get(session, name, file, url, most, token)
            if sizes[file] not in (None, len(data)):
                raise ConnectionError(f"{file} has {len(data):,} bytes of {sizes[file]:,}")
            if token and token.encode() in data:
                raise UserError(f"{name}: {file} holds your HF_TOKEN; nothing of it is kept")
    return commit, files


async def _get(session: Any, name: str, what: str, url: str, most: int, token: str | None) -> bytes:
    """Return at most so many bytes of a response, which are not unpacked.

    Another host that the Hub leads to is not sent the token.
    """
    from huggingface_hub.utils import hf_raise_for_status  # type: ignore[attr-defined]

    headers = {"accept-encoding": "identity"} | ({"authorization": f"Bearer {token}"} if token else {})
    data = bytearray()
    async with session.stream("GET", url, headers=headers, follow_redirects=True, timeout=None) as response:
        async for part in response.aiter_raw():
            data += part
            if len(data) > most and response.status_code < 300:
                raise UserError(f"{name}: {what} holds more than {most:,} bytes, which are allowed")
            if len(data) > most:
                break
        kept = {key: value for key, value in response.headers.items() if key.startswith("x-error-")}
        short = type(response)(
            response.status_code, headers=kept, content=bytes(data[:most]), request=response.request
        )
    hf_raise_for_status(short)
    return bytes(short.content)


def _check_files(name: str, sizes: Mapping[str, int | None]) -> None:
    """Check that an agent is among the files, and log which files are ignored."""
    for file, most in AGENT_FILES.items():
        if file not in sizes:
            raise UserError(f"{name}: holds no agent: {file} is missing")
        if (sizes[file] or 0) > most:
            raise UserError(f"{name}: {file} holds {sizes[file]:,} bytes, at most {most:,} are allowed")
    if others := sorted(set(sizes) - set(PUSHED_FILES)):
        named = redact(", ".join(f"{other:.40}" for other in others[:_MOST_NAMED]))
        more = f" and {len(others) - _MOST_NAMED} more" if len(others) > _MOST_NAMED else ""
        _logger.info(f"{name}: ignored {named}{more}; only {' and '.join(AGENT_FILES)} are read, no pickle")


def redact(text: str) -> str:
    """Return a text in which a server does not show the token of ``HF_TOKEN``, nor control a terminal."""
    token = os.environ.get("HF_TOKEN", "").strip()
    return printable(text if len(token) < _SHORTEST_SECRET else text.replace(token, "***"))


@contextlib.contextmanager
def hub_errors(where: str) -> Iterator[None]:
    """Turn the client library's exceptions into one line; silence its progress bars and warnings.

    Args:
        where: the repository; begins the message.

    Raises:
        UserError: the Hub refused, failed or could not be reached.
        OSError: a file cannot be read or written.
    """
    from huggingface_hub import constants, errors
    from huggingface_hub.utils.tqdm import (
        are_progress_bars_disabled,
        disable_progress_bars,
        enable_progress_bars,
    )

    logger = logging.getLogger("huggingface_hub")
    level, shows_bars = logger.level, not are_progress_bars_disabled()
    logger.setLevel(logging.CRITICAL)
    disable_progress_bars()
    hub, own = constants.ENDPOINT, os.environ.get("HF_TOKEN", "").strip()
    try:
        yield
    except UserError:
        raise
    except errors.GatedRepoError:
        raise UserError(f"{where}: its owner grants access on request; ask for it at {hub}") from None
    except errors.RepositoryNotFoundError:
        hint = "that HF_TOKEN may not read" if own else "(HF_TOKEN is not set)"
        raise UserError(f"{where}: no such repository on {hub}, or a private one {hint}") from None
    except errors.RevisionNotFoundError:
        raise UserError(f"{where}: has no such revision") from None
    except errors.HfHubHTTPError as error:
        status = error.response.status_code
        refused = {401: "HF_TOKEN is not valid", 403: "HF_TOKEN does not allow this"}
        reason = redact(refused.get(status) or error.server_message or first_line(error))
        raise UserError(f"{where}: {hub} answers with status {status}: {reason:.300}") from None
    except (errors.HTTPError, errors.LocalEntryNotFoundError, ConnectionError) as error:  # type: ignore[attr-defined]
        cause = error.__cause__ or error
        reason = redact(first_line(cause))
        raise UserError(f"{where}: {hub} cannot be reached, or broke off: {reason:.300}") from None
    except (OSError, RuntimeError, ValueError) as error:  # of the library's own checks
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise UserError(f"{where}: {redact(first_line(error.__cause__ or error)):.300}") from None
    finally:
        logger.setLevel(level)
        if shows_bars:
            enable_progress_bars()
